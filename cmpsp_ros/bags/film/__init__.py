"""A run as a camera behind the robot would have seen it."""

from cmpsp_ros.bags.film.render import film

__all__ = ['film']
