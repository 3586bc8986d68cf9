// What scrolls sideways can be reached by the keyboard.
const reach = () => {
  for (const part of document.querySelectorAll(".equation, .md-typeset__scrollwrap, pre > code, p:has(> img)"))
    if (part.scrollWidth > part.clientWidth) part.tabIndex = 0; else part.removeAttribute("tabindex");
};
addEventListener("load", reach);
addEventListener("resize", reach);
