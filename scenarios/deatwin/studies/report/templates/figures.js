"use strict";
// Figures are magnified by changing the view box of their SVG; their data are kept, compressed, in the page.
// Without this script figures and tables are shown as they are, and the links lead to the files beside the page.
(() => {
  const MOST = 40, STEP = 1.5, SHARE = 0.1;

  function zoomable(frame) {
    const svg = frame.querySelector("svg"), figure = frame.closest("figure");
    const [x, y, width, height] = svg.getAttribute("viewBox").split(" ").map(Number);
    const whole = { x, y, width, height }, fingers = new Map();
    let view = { ...whole };

    const place = (event) => new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse());
    const centre = () => ({ x: view.x + view.width / 2, y: view.y + view.height / 2 });
    const zoomed = () => view.width < 0.999 * whole.width;

    function show() {
      view.x = Math.min(Math.max(view.x, whole.x), whole.x + whole.width - view.width);
      view.y = Math.min(Math.max(view.y, whole.y), whole.y + whole.height - view.height);
      svg.setAttribute("viewBox", [view.x, view.y, view.width, view.height].join(" "));
      frame.classList.toggle("zoomed", zoomed());
    }

    function zoom(factor, about = centre()) {
      const width = Math.min(whole.width, Math.max(whole.width / MOST, view.width / factor)), share = width / view.width;
      view = { x: about.x + (view.x - about.x) * share, y: about.y + (view.y - about.y) * share,
               width, height: view.height * share };
      show();
    }

    function move(right, down) {
      view.x += right;
      view.y += down;
      show();
    }

    function reset() {
      view = { ...whole };
      show();
    }

    const keys = {
      "+": () => zoom(STEP), "=": () => zoom(STEP), "-": () => zoom(1 / STEP), 0: reset,
      ArrowLeft: () => move(-SHARE * view.width, 0), ArrowRight: () => move(SHARE * view.width, 0),
      ArrowUp: () => move(0, -SHARE * view.height), ArrowDown: () => move(0, SHARE * view.height),
    };
    frame.addEventListener("keydown", (event) => {
      const arrow = event.key.startsWith("Arrow"), act = keys[event.key];
      if (!act || event.ctrlKey || event.metaKey || event.altKey || (arrow && !zoomed())) return;
      event.preventDefault();
      act();
    });
    frame.addEventListener("wheel", (event) => {
      if (!event.ctrlKey && !event.metaKey && !document.fullscreenElement) return;  // the page scrolls
      event.preventDefault();
      zoom(Math.exp(-event.deltaY / (event.deltaMode ? 10 : 300)), place(event));
    }, { passive: false });
    svg.addEventListener("dblclick", (event) => zoom(STEP * STEP, place(event)));

    svg.addEventListener("pointerdown", (event) => {
      fingers.set(event.pointerId, { x: event.clientX, y: event.clientY });
      if (zoomed() || fingers.size > 1) svg.setPointerCapture(event.pointerId);
    });
    svg.addEventListener("pointermove", (event) => {
      const before = fingers.get(event.pointerId), other = [...fingers].find(([id]) => id !== event.pointerId)?.[1];
      if (!before) return;
      const now = { x: event.clientX, y: event.clientY }, scale = 1 / svg.getScreenCTM().a;
      const apart = (finger) => Math.hypot(finger.x - other.x, finger.y - other.y);
      if (other) zoom(apart(now) / Math.max(1, apart(before)), place({ clientX: other.x, clientY: other.y }));
      else if (zoomed()) move((before.x - now.x) * scale, (before.y - now.y) * scale);
      fingers.set(event.pointerId, now);
    });
    for (const end of ["pointerup", "pointercancel", "pointerleave"])
      svg.addEventListener(end, (event) => fingers.delete(event.pointerId));

    const tools = document.createElement("div"), title = svg.getAttribute("aria-label");
    const button = (sign, name, act) => {
      const made = Object.assign(document.createElement("button"), { type: "button", textContent: sign, title: name });
      made.setAttribute("aria-label", `${name}: ${title}`);
      made.addEventListener("click", act);
      tools.append(made);
    };
    tools.className = "tools";
    button("+", "zoom in", () => zoom(STEP));
    button("−", "zoom out", () => zoom(1 / STEP));
    button("1:1", "whole figure", reset);
    if (document.fullscreenEnabled)
      button("full", "full screen", () => (document.fullscreenElement ? document.exitFullscreen() : figure.requestFullscreen()));
    frame.before(tools);
    frame.title = "Ctrl and wheel, pinch, double click or + and − to zoom; drag or arrow keys to move; 0 for the whole";
  }

  function downloadable(link, kept) {
    link.addEventListener("click", async (event) => {
      event.preventDefault();
      const packed = Uint8Array.from(atob(kept.content.textContent.trim()), (letter) => letter.charCodeAt(0));
      const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
      const address = URL.createObjectURL(new Blob([await new Response(stream).blob()], { type: "text/csv" }));
      const name = link.getAttribute("href").split("/").pop();
      Object.assign(document.createElement("a"), { href: address, download: name }).click();
      setTimeout(() => URL.revokeObjectURL(address), 60000);
    });
  }

  // On a narrow screen each row of a table becomes a block: its first cell is a title, and every other cell is led by the
  // heading of its column. A table of numbers stays one if it fits, so that its columns can be compared.
  function labelled(table) {
    const heads = [...table.querySelectorAll("thead th")].map((head) => head.textContent.trim());
    if (heads.length < 3) return;
    const numbers = table.querySelectorAll("thead th.n").length === heads.length - 1;
    let cells = 0;  // letters in them
    const below = heads.map(() => 0);  // rows for which a cell above still fills the column
    for (const row of table.querySelectorAll("tbody tr")) {
      let column = 0;
      for (const cell of row.cells) {
        while (below[column] > 0) below[column++] -= 1;
        if (cell.colSpan === 1) cell.dataset.label = heads[column] ?? "";
        cell.classList.toggle("head", column === 0);
        if (column > 0) cells += cell.textContent.trim().length;
        below[column] = cell.rowSpan - 1;
        column += cell.colSpan;
      }
      while (column < heads.length) below[column] = Math.max(0, below[column++] - 1);
    }
    const fit = () => {
      table.classList.toggle("stacks", !numbers);
      if (numbers) table.classList.toggle("stacks", table.offsetWidth > table.parentElement.clientWidth);
    };
    const labels = heads.slice(1).join("").length * table.querySelectorAll("tbody tr").length;
    table.classList.toggle("labels", labels > cells);  // the longer ones get more room
    table.classList.toggle("numbers", numbers);
    addEventListener("resize", fit);
    fit();
  }

  document.querySelectorAll("table").forEach(labelled);
  document.querySelectorAll("figure .view").forEach(zoomable);
  const files = new Map([...document.querySelectorAll("template[data-file]")].map((kept) => [kept.dataset.file, kept]));
  if (window.DecompressionStream)
    for (const link of document.querySelectorAll("a.data"))
      if (files.has(link.getAttribute("href"))) downloadable(link, files.get(link.getAttribute("href")));
})();
