"""A look at recordings before any model is made of them."""

from deatwin.ident.look.look import Look, look_at

__all__ = ["Look", "look_at"]
