"""What an arm can do: functions that return a generator of motion steps. Distances in m, speeds in
m/s of the tcp; sides are "left" and "right"."""

from .gestures import pour, turn
from .hand import close, grasp, open_, pause
from .handing_over import face, hand_over
from .moving import carry, home, lift, lift_clear, move, retreat, shift
from .pairing import first_of, in_turn, together, track
from .setting import ROUND, place, press, resting_poses, upright_goal
from .swinging import rock, shake
