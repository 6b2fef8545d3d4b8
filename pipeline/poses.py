"""Rigid poses as plain arrays: float64 `(7,)`, position xyz in metres, then a unit quaternion wxyz.

`a * b` in the usual notation is `compose(a, b)`: first b, then a. Functions broadcast over leading
dimensions if their docstring has `(..., 7)`."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]
Floats32 = NDArray[np.float32]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
Pixels = NDArray[np.uint8]
Pose = Floats

IDENTITY: Pose = np.array([0.0, 0, 0, 1, 0, 0, 0])
IDENTITY.setflags(write=False)


def pose(position: ArrayLike = (0, 0, 0), quaternion: ArrayLike = (1, 0, 0, 0)) -> Pose:
    """Pose `(7,)` from a position (m) and a quaternion wxyz, which is normalised."""
    q = np.asarray(quaternion, float)
    return np.concatenate([np.asarray(position, float), q / np.linalg.norm(q)])


# Written out by component: numpy's own cross and moveaxis cost far more than the arithmetic on the
# few numbers of a pose.


def quat_multiply(a: ArrayLike, b: ArrayLike) -> Floats:
    """Hamilton product of quaternions wxyz, `(..., 4)` x `(..., 4)` -> `(..., 4)`."""
    return _joined(_multiply(_parts(a), _parts(b)))


def _parts(a: ArrayLike) -> list[Any]:
    """Components along the last axis; plain floats for a single vector, the fastest."""
    a = np.asarray(a, float)
    return a.tolist() if a.ndim == 1 else [a[..., i] for i in range(a.shape[-1])]


def _joined(parts: list[Any]) -> Floats:
    """The array (..., n) of n components (...) of one shape."""
    if type(parts[0]) is float:
        return np.array(parts)
    out = np.empty((*parts[0].shape, len(parts)))
    for i, part in enumerate(parts):
        out[..., i] = part
    return out


def _multiply(a: list[Any], b: list[Any]) -> list[Any]:
    (aw, ax, ay, az), (bw, bx, by, bz) = a, b
    return [
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    ]


def quat_rotate(q: ArrayLike, v: ArrayLike) -> Floats:
    """Rotate vectors `(..., 3)` by unit quaternions wxyz `(..., 4)`."""
    return _joined(_rotate(_parts(q), _parts(v)))


def _rotate(q: list[Any], v: list[Any]) -> list[Any]:
    """v + w t + u x t with u the vector part and t = 2 u x v."""
    (w, x, y, z), (a, b, c) = q, v
    tx, ty, tz = 2.0 * (y * c - z * b), 2.0 * (z * a - x * c), 2.0 * (x * b - y * a)
    return [
        a + w * tx + (y * tz - z * ty),
        b + w * ty + (z * tx - x * tz),
        c + w * tz + (x * ty - y * tx),
    ]


def quat_about(axis: ArrayLike, angle: float) -> Floats:
    """Quaternion wxyz of a rotation by `angle` rad about `axis` (any length)."""
    n = np.asarray(axis, float)
    n = n / np.linalg.norm(n)
    return np.concatenate([[np.cos(angle / 2)], np.sin(angle / 2) * n])


def quat_from_rpy(roll: float, pitch: float, yaw: float) -> Floats:
    """URDF fixed-axis roll, pitch, yaw (rad) -> quaternion wxyz: Rz(yaw) Ry(pitch) Rx(roll)."""
    return quat_multiply(
        quat_multiply(quat_about((0, 0, 1), yaw), quat_about((0, 1, 0), pitch)),
        quat_about((1, 0, 0), roll),
    )


def quat_from_matrix(m: ArrayLike) -> Floats:
    """Rotation matrix `(3, 3)` -> quaternion wxyz with w >= 0 (Shepperd's method)."""
    m = np.asarray(m, float)
    t = np.array([np.trace(m), m[0, 0], m[1, 1], m[2, 2]])
    i = int(np.argmax(t))
    if i == 0:
        q = np.array([1 + t[0], m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]])
    else:
        a, b, c = i - 1, i % 3, (i + 1) % 3
        q = np.empty(4)
        q[0] = m[c, b] - m[b, c]
        q[a + 1] = 1 + m[a, a] - m[b, b] - m[c, c]
        q[b + 1] = m[b, a] + m[a, b]
        q[c + 1] = m[c, a] + m[a, c]
    q /= np.linalg.norm(q)
    return -q if q[0] < 0 else q


def quat_to_matrix(q: ArrayLike) -> Floats:
    """Unit quaternions wxyz `(..., 4)` -> rotation matrices `(..., 3, 3)`."""
    q = np.asarray(q, float)
    w, x, y, z = _parts(q)
    out = np.empty((*q.shape[:-1], 3, 3))
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    for i, j in np.ndindex(3, 3):
        out[..., i, j] = rows[i][j]
    return out


def frame(position: ArrayLike, x_axis: ArrayLike, y_axis: ArrayLike) -> Pose:
    """Pose with this x axis, whose y axis lies in the plane of both (Gram-Schmidt)."""
    x = np.asarray(x_axis, float)
    x = x / np.linalg.norm(x)
    y = np.asarray(y_axis, float)
    y = y - x * (x @ y)
    y = y / np.linalg.norm(y)
    return pose(position, quat_from_matrix(np.stack([x, y, np.cross(x, y)], axis=1)))


def compose(a: ArrayLike, b: ArrayLike) -> Pose:
    """Pose product a * b, `(..., 7)` x `(..., 7)` -> `(..., 7)`."""
    p, q = _parts(a), _parts(b)
    moved = _rotate(p[3:], q[:3])
    return _joined([x + y for x, y in zip(moved, p, strict=False)] + _multiply(p[3:], q[3:]))


def inverse(a: ArrayLike) -> Pose:
    """Inverse pose, `(..., 7)`."""
    *at, w, x, y, z = _parts(a)
    turn = [w, -x, -y, -z]
    return _joined([-along for along in _rotate(turn, at)] + turn)


def transform(a: ArrayLike, points: ArrayLike) -> Floats:
    """Points `(..., 3)` of the local frame of pose `a` `(..., 7)`, in its parent frame."""
    a = np.asarray(a, float)
    return a[..., :3] + quat_rotate(a[..., 3:], points)


def matrix(a: ArrayLike) -> Floats:
    """Homogeneous matrix `(..., 4, 4)` of poses `(..., 7)`."""
    a = np.asarray(a, float)
    m = np.zeros((*a.shape[:-1], 4, 4))
    m[..., :3, :3] = quat_to_matrix(a[..., 3:])
    m[..., :3, 3] = a[..., :3]
    m[..., 3, 3] = 1.0
    return m


def from_matrix(m: ArrayLike) -> Pose:
    """Pose `(7,)` of a homogeneous matrix `(4, 4)`."""
    m = np.asarray(m, float)
    return pose(m[:3, 3], quat_from_matrix(m[:3, :3]))


def quat_conjugate(q: ArrayLike) -> Floats:
    """The inverse of unit quaternions (..., 4) wxyz."""
    return np.asarray(q, float) * [1.0, -1.0, -1.0, -1.0]


def rotation_vector(q: ArrayLike) -> Floats:
    """Rotation vector (3,), rad, of a unit quaternion wxyz, the short way round."""
    q = np.asarray(q, float)
    q = q if q[0] >= 0 else -q
    sine = float(np.linalg.norm(q[1:]))
    return 2 * q[1:] if sine < 1e-9 else q[1:] / sine * 2 * np.arctan2(sine, q[0])


def angle_between(a: ArrayLike, b: ArrayLike) -> float:
    """Rotation angle in rad between two quaternions wxyz."""
    d = abs(float(np.dot(np.asarray(a, float), np.asarray(b, float))))
    return 2.0 * float(np.arccos(min(1.0, d)))


def lifted(p: Pose, height: float) -> Pose:
    """The same pose `height` m higher."""
    return p + np.array([0, 0, height, 0, 0, 0, 0])


def yawed(position: ArrayLike, yaw: float) -> Pose:
    """Upright pose turned by `yaw` rad about world z."""
    return pose(position, quat_about((0, 0, 1), yaw))


def between(poses: Floats, at: ArrayLike) -> Floats:
    """Poses (N,...,7) at times `at` (N,) in frames, from those at the frames (T,...,7): linear
    between two, quaternions normalised. Earlier times have the first pose."""
    t = np.clip(np.asarray(at, float), 0, len(poses) - 1)
    low = np.floor(t).astype(int)
    share = (t - low).reshape(-1, *([1] * (poses.ndim - 1)))
    a, b = poses[low], poses[np.minimum(low + 1, len(poses) - 1)]
    nearer = np.where((a[..., 3:] * b[..., 3:]).sum(-1, keepdims=True) < 0, -1.0, 1.0)
    mixed = a + (np.concatenate([b[..., :3], b[..., 3:] * nearer], -1) - a) * share
    mixed[..., 3:] /= np.linalg.norm(mixed[..., 3:], axis=-1, keepdims=True)
    return np.where(share == 0, a, mixed)
