"""What an arm can do, as generators of motion steps. Distances in m, tcp speeds in m/s."""

from .gestures import pour, turn
from .hand import close, grasp, open_, pause
from .handing_over import face, hand_over
from .moving import carry, home, lift, lift_clear, move, retreat, shift
from .pairing import first_of, in_turn, together, track
from .setting import ROUND, place, press, resting_poses, upright_goal
from .swinging import rock, shake
