"""The packages whose `__init__` is the public border; the reference shows what they export."""

PUBLIC = (
    "deatwin.plant",
    "deatwin.plant.effects",
    "deatwin.plant.excitation",
    "deatwin.plant.export",
    "deatwin.plant.files",
    "deatwin.plant.foreign",
    "deatwin.plant.laws",
    "deatwin.ident",
    "deatwin.ident.look",
    "deatwin.ident.materials",
    "deatwin.ident.narx",
    "deatwin.ident.narx.linear",
    "deatwin.ident.nss",
    "deatwin.ident.narx.preprocess",
    "deatwin.ident.frequency",
    "deatwin.ident.greybox",
    "deatwin.ident.mismatch",
    "deatwin.control",
    "deatwin.control.export",
    "deatwin.studies.sweep",
)
