"""What an arm can do: functions that return a generator of motion steps. Distances in m, speeds in
m/s of the tcp; sides are "left" and "right"."""

from pipeline.expert.skills.choice import first_of, in_turn
from pipeline.expert.skills.facing import face
from pipeline.expert.skills.gestures import pour, turn
from pipeline.expert.skills.hand import close, grasp, open_, pause
from pipeline.expert.skills.handing_over import hand_over
from pipeline.expert.skills.moving import carry, home, lift, lift_clear, move, retreat, shift
from pipeline.expert.skills.pairing import together
from pipeline.expert.skills.setting import ROUND, place, press, resting_poses, upright_goal
from pipeline.expert.skills.swinging import rock, shake
from pipeline.expert.skills.tracking import track
