"""How a motion travels over the ground, and how to lead it along another line.

A locomotion is a body that sways about a smooth line, its track. Where the body is led along another line, each frame
is moved and turned as a whole, so that what it does about its track stays as it was.
"""

from motiongen.trajectory.follow import PACE, follow, follow_in_a_loop, frames_to_follow
from motiongen.trajectory.path import GroundPath, path_through
from motiongen.trajectory.track import TRAVEL_SPEED, Track, shifted, straightened, track_of, travel_speed

__all__ = [
    "PACE",
    "TRAVEL_SPEED",
    "GroundPath",
    "Track",
    "follow",
    "follow_in_a_loop",
    "frames_to_follow",
    "path_through",
    "shifted",
    "straightened",
    "track_of",
    "travel_speed",
]
