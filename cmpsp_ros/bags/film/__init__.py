"""A film of a run, from a camera behind the robot."""

from cmpsp_ros.bags.film.render import film
