"""A look at recordings before any model is made of them."""

from deatwin.ident.look.inputs import InputPattern, InputShape
from deatwin.ident.look.link import Link, LinkStatus
from deatwin.ident.look.look import ChannelLook, Look, look_at

__all__ = ["ChannelLook", "InputPattern", "InputShape", "Link", "LinkStatus", "Look", "look_at"]
