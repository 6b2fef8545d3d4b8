"""Search budgets, cost weights, margins and speeds of the expert. Costs are joint distances in rad
(m for a prismatic joint) from the arm's command."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Speeds:
    """Speeds of the tcp along straight lines, m/s."""

    approach: float = 0.30
    lift: float = 0.25
    retreat: float = 0.30
    shift: float = 0.15
    place: float = 0.20
    press: float = 0.10
    creep: float = 0.003
    """Of fingertips just before they touch: at 5 mm/s one step pushed a stapler with 38 N."""
    swing_scale: float = 2.0  # times the planned joint speeds, for shaking, rocking and turning


@dataclass(frozen=True)
class HandTiming:
    """What the jaws do, s."""

    squeeze: float = 0.15  # after the jaws have closed or opened
    press: float = 0.40
    """Of fingertips on what they press. A policy that imitates 0.1 s turns back 1 cm above it."""


@dataclass(frozen=True)
class GraspSearch:
    """How a grasp is chosen."""

    tries: int = 12  # free motions to a standoff that are searched at most
    standoff: float = 0.08  # m, straight line on which the open hand comes in
    short: float = 0.004  # m by which it may end earlier, where fingers come too near to the table
    short_share: float = 0.5  # of it, where the arm does not reach the whole
    lift: float = 0.08  # m by which the hand must be able to rise straight up
    above_goal: float = 0.06  # m from which the hand should come straight down onto a goal
    passing: float = 0.005  # m to other bodies on the line: room for an arm that lags behind
    open: float = 0.99  # gripper value from which on the jaws count as open
    openings: tuple[float, ...] = (1.0, 0.65, 0.4)
    """Tried in turn: jaws opened all the way do not fit into a small bowl."""
    spare_opening: float = 0.008  # m by which the jaws open wider than the object
    pitch: float = 0.9  # preferred approach, rad below the horizontal
    pitch_weight: float = 1.0  # per rad off it
    lever_weight: float = 15.0
    """Per m between tcp and the body's origin, seen from above: held off its middle it droops."""
    limit_weight: float = 1.5  # gain per unit of `kinematics.limit_margin`, up to `limit_margin`
    limit_margin: float = 0.3
    goal_batch: int = 12  # goal poses solved at a time
    avoided: float = 0.7  # rad between approaches that count as the same, where one is avoided
    avoided_cost: float = 100.0  # more than all other costs together


@dataclass(frozen=True)
class SeatSearch:
    """Where a body is set down between two grasps."""

    xs: tuple[float, ...] = (0.0, 0.08, 0.16, 0.24, 0.30)  # m from the middle, on the arm's side
    ys: tuple[float, ...] = (-0.20, -0.12, -0.04, 0.04, 0.12)  # m
    turns: int = 12  # yaw angles at each place
    gap: float = 0.03  # m kept to other bodies, seen from above
    grasps: int = 40  # by which seats are judged, evenly chosen among those in reach
    tries: int = 24  # seats looked at closely, those that leave most grasps first
    wanted: int = 3  # seats to choose from while the body is carried
    above: float = 0.06  # m from which the body comes straight down


@dataclass(frozen=True)
class MoveSearch:
    """How far a hand moves if it cannot move all the way, as shares in turn."""

    tries: int = 8  # free motions that are searched at most
    lift_shares: tuple[float, ...] = (1.0, 0.8, 0.6, 0.4, 0.2)
    least_lift: float = 0.25
    shift_shares: tuple[float, ...] = (1.0, 0.9, 0.8)
    retreat_shares: tuple[float, ...] = (1.0, 0.8, 0.6, 0.4, 0.2)
    rise_shares: tuple[float, ...] = (1.0, 0.6)
    """Of a retreat, straight up, if the hand cannot draw back."""
    steps_off: tuple[float, ...] = (0.01, 0.02, 0.04)
    """m by which an arm too near to something moves off before it goes home."""
    rises: tuple[float, ...] = (0.08, 0.16)  # m by which it rises instead


@dataclass(frozen=True)
class PlaceSearch:
    """How a held body is set down."""

    above: float = 0.10  # m from which it comes straight down
    press: float = 0.003  # m by which it is pressed beyond the goal
    drop: float = 0.002  # m over the goal at which it may end, if fingers would come to the table
    height_shares: tuple[float, ...] = (1.0, 0.5, 0.25)  # of `above` that are tried
    height_weight: float = 6.0  # of coming down from no height instead of all of `above`
    draw_back: float = 0.08  # m by which the hand should be able to draw back
    judged: int = 36  # approaches whose contacts are looked at together, cheapest first
    tries: int = 12  # approaches, least contact first, to which a free motion is searched
    settling: float = 0.01  # m over the goal down to which the body should touch nothing
    touch_penalty: int = 8  # the arm touches something
    near_penalty: int = 3
    """Nearer than MARGINS.obstacles, or the body touches something on its way; 1 if open jaws would
    touch something, or there is no way back."""


@dataclass(frozen=True)
class HandOverSearch:
    """Where a body changes hands."""

    judged: int = 24  # places for which a grasp of the receiver is searched, about
    tries: int = 3  # free motions of the giver to a place
    pitch: float = 0.4  # preferred approach of the receiver, rad below the horizontal
    draw_back: float = 0.09  # m by which the giver should be able to draw back


@dataclass(frozen=True)
class PressSearch:
    """How fingertips touch a spot from above."""

    above: float = 0.08  # m over the spot
    depth: float = 0.004  # m beyond the spot within which the touch is expected
    gap: float = 0.0006  # m before the touch from which they creep
    squeeze: float = 0.0003  # m after the touch: the drives turn it into some 10 N
    pitches: tuple[float, ...] = (1.55, 1.25, 1.4, 1.0, 0.8)  # rad below the horizontal
    azimuths: int = 16  # directions tried for each pitch
    steep: float = 1.55
    """Preferred approach, rad: a slanting finger pushes the body away, and bars one from under
    it."""
    steep_weight: float = 2.0  # per rad off it
    tries: int = 24  # cheapest approaches tried
    clear_share: tuple[int, int] = (3, 4)
    """Of the way down, on which nothing may be touched."""


@dataclass(frozen=True)
class PourSearch:
    """How a held body is tipped."""

    sway: float = 0.16  # m within which its origin stays of where tipping begins or ends
    pairs: int = 400  # cheapest pairs of an upright and a tipped posture looked at
    tries: int = 80  # pairs with a free end that are checked along the motion
    rows: int = 16  # joint rows checked along the motion
    stream: tuple[float, float] = (-0.02, 0.08)
    """m from the rim, outwards along the axis, between which the stream is seen."""
    stream_points: int = 6
    rim: float = 0.012  # m of the middle of the stream from the outer edge of the rim
    fall: float = 9.0  # 1/m, of the parabola by which the stream falls
    room: float = 0.03  # m that the hand should keep from what is poured
    room_weight: float = 200.0  # per m that is missing
    lever_weight: float = 100.0
    """Per m by which the weight pulls off the axis of the jaws: the body turns in the grip."""
    level_weight: float = 10.0  # per 1 - cos of the opening's angle from straight down


@dataclass(frozen=True)
class SwingSearch:
    """How a held body is shaken or rocked."""

    shake_tries: int = 6  # free motions to where the body is shaken that may fail
    shake_angles: tuple[float, ...] = (0.9, 0.75, 0.65, 0.55)  # rad to either side, widest first
    least_angle: float = 0.52  # rad of tilt to either side
    slopes: tuple[float, ...] = (0.0, 0.5, -0.5)  # rad of the axis
    quarter_turns: tuple[int, ...] = (0, 1, -1, 2)
    """Headings of the axis, in 45 degrees from the hand's approach."""
    near_heights: tuple[float, ...] = (0.0, 0.06)
    """m upwards, of places nearby for a hand without room."""
    near_offsets: tuple[float, ...] = (0.0, 0.09, -0.09)  # m along x and along y
    near_turns: tuple[float, ...] = (0.0, 0.6, -0.6)  # rad about the vertical
    rock_tries: int = 12  # free motions to where the body is rocked
    rock_angles: tuple[float, ...] = (0.85, 0.7, 0.6)  # rad to either side, widest first


SPEEDS = Speeds()
TIMING = HandTiming()
GRASP = GraspSearch()
SEAT = SeatSearch()
MOVE = MoveSearch()
PLACE = PlaceSearch()
HAND_OVER = HandOverSearch()
PRESS = PressSearch()
POUR = PourSearch()
SWING = SwingSearch()
