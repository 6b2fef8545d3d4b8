"""Numba kernels of kinematics of a serial chain, by Levenberg-Marquardt with the damping of
Sugihara (T-RO 2011).

`pre` (n,3,4) are the transforms before each joint, whose axis is local z; `tool` is (3,4). One
file: numba's cache ignores changes of other files. Rows are copied by entry because assigning
arrays takes 2 s more to compile.
"""

import numpy as np
from numba import njit

kernel = njit(cache=True, error_model="numpy")
ROTATION_WEIGHT = 0.25  # m for a radian of tool rotation, roughly the length of a forearm
DAMPING = 1e-6
FAR = 0.1  # m: of the targets that four starts leave this far away, 99 % are out of reach
STEP_LIMIT = 0.7  # rad or m per iteration, for which the Jacobian means anything


@kernel
def forward(pre, prismatic, tool, q, axes, origins, rotation, position):
    """Write joint axes and origins (n,3) and the tool's pose, in the world."""
    r00, r01, r02 = 1.0, 0.0, 0.0
    r10, r11, r12 = 0.0, 1.0, 0.0
    r20, r21, r22 = 0.0, 0.0, 1.0
    x, y, z = 0.0, 0.0, 0.0
    n = q.shape[0]
    for i in range(n + 1):
        t = pre[i] if i < n else tool
        x += r00 * t[0, 3] + r01 * t[1, 3] + r02 * t[2, 3]
        y += r10 * t[0, 3] + r11 * t[1, 3] + r12 * t[2, 3]
        z += r20 * t[0, 3] + r21 * t[1, 3] + r22 * t[2, 3]
        a, b, c = r00, r01, r02
        r00 = a * t[0, 0] + b * t[1, 0] + c * t[2, 0]
        r01 = a * t[0, 1] + b * t[1, 1] + c * t[2, 1]
        r02 = a * t[0, 2] + b * t[1, 2] + c * t[2, 2]
        a, b, c = r10, r11, r12
        r10 = a * t[0, 0] + b * t[1, 0] + c * t[2, 0]
        r11 = a * t[0, 1] + b * t[1, 1] + c * t[2, 1]
        r12 = a * t[0, 2] + b * t[1, 2] + c * t[2, 2]
        a, b, c = r20, r21, r22
        r20 = a * t[0, 0] + b * t[1, 0] + c * t[2, 0]
        r21 = a * t[0, 1] + b * t[1, 1] + c * t[2, 1]
        r22 = a * t[0, 2] + b * t[1, 2] + c * t[2, 2]
        if i == n:
            break
        axes[i, 0], axes[i, 1], axes[i, 2] = r02, r12, r22
        origins[i, 0], origins[i, 1], origins[i, 2] = x, y, z
        if prismatic[i]:
            x += r02 * q[i]
            y += r12 * q[i]
            z += r22 * q[i]
        else:
            co, si = np.cos(q[i]), np.sin(q[i])
            r00, r01 = r00 * co + r01 * si, r01 * co - r00 * si
            r10, r11 = r10 * co + r11 * si, r11 * co - r10 * si
            r20, r21 = r20 * co + r21 * si, r21 * co - r20 * si
    rotation[0, 0], rotation[0, 1], rotation[0, 2] = r00, r01, r02
    rotation[1, 0], rotation[1, 1], rotation[1, 2] = r10, r11, r12
    rotation[2, 0], rotation[2, 1], rotation[2, 2] = r20, r21, r22
    position[0], position[1], position[2] = x, y, z


@kernel
def quaternion(m, out):
    """Write the quaternion wxyz (w >= 0) of a matrix, by Shepperd's method."""
    trace = m[0, 0] + m[1, 1] + m[2, 2]
    if trace >= m[0, 0] and trace >= m[1, 1] and trace >= m[2, 2]:
        out[0] = 1 + trace
        out[1], out[2], out[3] = m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]
    else:
        a = 0
        if m[1, 1] > m[0, 0]:
            a = 1
        if m[2, 2] > m[a, a]:
            a = 2
        b, c = (a + 1) % 3, (a + 2) % 3
        out[0] = m[c, b] - m[b, c]
        out[1 + a] = 1 + m[a, a] - m[b, b] - m[c, c]
        out[1 + b] = m[b, a] + m[a, b]
        out[1 + c] = m[c, a] + m[a, c]
    norm = np.sqrt(out[0] ** 2 + out[1] ** 2 + out[2] ** 2 + out[3] ** 2)
    if out[0] < 0:
        norm = -norm
    for i in range(4):
        out[i] /= norm


@kernel
def poses_of(pre, prismatic, tool, q):
    """Tool poses (N,7) of q (N,n)."""
    count, n = q.shape
    axes, origins, rotation = np.empty((n, 3)), np.empty((n, 3)), np.empty((3, 3))
    out = np.empty((count, 7))
    for k in range(count):
        forward(pre, prismatic, tool, q[k], axes, origins, rotation, out[k, :3])
        quaternion(rotation, out[k, 3:])
    return out


@kernel
def column(axis, origin, position, prismatic, weight, out):
    """Write a Jacobian column (6,), its angular part times `weight`."""
    if prismatic:
        out[0], out[1], out[2] = axis[0], axis[1], axis[2]
        out[3], out[4], out[5] = 0.0, 0.0, 0.0
    else:
        dx, dy, dz = position[0] - origin[0], position[1] - origin[1], position[2] - origin[2]
        out[0] = axis[1] * dz - axis[2] * dy
        out[1] = axis[2] * dx - axis[0] * dz
        out[2] = axis[0] * dy - axis[1] * dx
        out[3], out[4], out[5] = axis[0] * weight, axis[1] * weight, axis[2] * weight


@kernel
def dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel
def pose_error(goal_r, goal_p, rotation, position, weight, out):
    """Write the weighted twist (6,) to the goal; (m, rad) off it."""
    px, py, pz = goal_p[0] - position[0], goal_p[1] - position[1], goal_p[2] - position[2]
    g, r = goal_r, rotation
    # E = G R^T; its skew part is axis * sin(angle), its trace 1 + 2 cos(angle).
    vx = dot(g[2], r[1]) - g[1, 0] * r[2, 0] - g[1, 1] * r[2, 1] - g[1, 2] * r[2, 2]
    vy = dot(g[0], r[2]) - g[2, 0] * r[0, 0] - g[2, 1] * r[0, 1] - g[2, 2] * r[0, 2]
    vz = dot(g[1], r[0]) - g[0, 0] * r[1, 0] - g[0, 1] * r[1, 1] - g[0, 2] * r[1, 2]
    trace = 0.0
    for i in range(3):
        trace += dot(g[i], r[i])
    sine2 = np.sqrt(vx * vx + vy * vy + vz * vz)
    angle = np.arctan2(sine2, trace - 1.0)
    # At half a turn the axis is lost in rounding; any axis will do, the next iteration has a
    # well-defined one.
    if sine2 > 1e-9:
        scale = weight * angle / sine2
        out[3], out[4], out[5] = vx * scale, vy * scale, vz * scale
    else:
        out[3], out[4], out[5] = weight * angle, 0.0, 0.0
    out[0], out[1], out[2] = px, py, pz
    return np.sqrt(px * px + py * py + pz * pz), angle


@kernel
def solve_spd(a, b, n):
    """Solve a x = b in place for symmetric positive definite a (n,n); destroys a."""
    for i in range(n):
        for j in range(i + 1):
            s = a[i, j]
            for k in range(j):
                s -= a[i, k] * a[j, k]
            a[i, j] = np.sqrt(s) if i == j else s / a[j, j]
        s = b[i]
        for k in range(i):
            s -= a[i, k] * b[k]
        b[i] = s / a[i, i]
    for i in range(n - 1, -1, -1):
        s = b[i]
        for k in range(i + 1, n):
            s -= a[k, i] * b[k]
        b[i] = s / a[i, i]


@kernel
def descend(chain, goal_r, goal_p, q, iterations, tolerance, work):
    """Move q (n,) in place; whether it is within `tolerance` (m, rad)."""
    pre, prismatic, tool, lower, upper = chain
    axes, origins, rotation, position, jac, error, h, step = work
    n = q.shape[0]
    checkpoint = np.inf
    for iteration in range(iterations):
        forward(pre, prismatic, tool, q, axes, origins, rotation, position)
        distance, angle = pose_error(goal_r, goal_p, rotation, position, ROTATION_WEIGHT, error)
        if distance < tolerance[0] and angle < tolerance[1]:
            return True
        squared = distance * distance + (ROTATION_WEIGHT * angle) ** 2
        if iteration % 4 == 3:
            if squared > 0.5 * checkpoint:
                return False
            checkpoint = squared
        damping = 0.5 * squared + DAMPING
        for i in range(n):
            column(axes[i], origins[i], position, prismatic[i], ROTATION_WEIGHT, jac[i])
        for attempt in range(2):
            for i in range(n):
                s = 0.0
                for k in range(6):
                    s += jac[i, k] * error[k]
                step[i] = s
                for j in range(i + 1):
                    s = 0.0
                    for k in range(6):
                        s += jac[i, k] * jac[j, k]
                    h[i, j] = s
                h[i, i] += damping
            solve_spd(h, step, n)
            blocked = False
            if attempt == 0:
                for i in range(n):
                    if (q[i] <= lower[i] and step[i] < 0.0) or (q[i] >= upper[i] and step[i] > 0.0):
                        blocked = True
                        for k in range(6):
                            jac[i, k] = 0.0
            if not blocked:
                break
        longest = 0.0
        for i in range(n):
            longest = max(longest, abs(step[i]))
        scale = STEP_LIMIT / longest if longest > STEP_LIMIT else 1.0
        for i in range(n):
            q[i] = min(max(q[i] + scale * step[i], lower[i]), upper[i])
    return False


@kernel
def workspace(n):
    return (
        np.empty((n, 3)),
        np.empty((n, 3)),
        np.empty((3, 3)),
        np.empty(3),
        np.empty((n, 6)),
        np.empty(6),
        np.empty((n, n)),
        np.empty(n),
    )


@kernel
def rotation_of(quat, out):
    """Write the rotation matrix (3,3) of a quaternion wxyz of any length."""
    norm = np.sqrt(quat[0] ** 2 + quat[1] ** 2 + quat[2] ** 2 + quat[3] ** 2)
    w, x, y, z = quat[0] / norm, quat[1] / norm, quat[2] / norm, quat[3] / norm
    out[0, 0], out[1, 1], out[2, 2] = y * y + z * z, x * x + z * z, x * x + y * y
    for i in range(3):
        out[i, i] = 1 - 2 * out[i, i]
    out[0, 1], out[1, 0] = 2 * (x * y - w * z), 2 * (x * y + w * z)
    out[0, 2], out[2, 0] = 2 * (x * z + w * y), 2 * (x * z - w * y)
    out[1, 2], out[2, 1] = 2 * (y * z - w * x), 2 * (y * z + w * x)


@kernel
def solve_many(chain, reach, targets, seeds, restarts, iterations, tolerance, few):
    """Solutions (N,n) and success (N,) for targets (N,7), from seeds (M,n), then `restarts`
    (R,n).
    """
    count, n = targets.shape[0], seeds.shape[1]
    out, ok = np.zeros((count, n)), np.zeros(count, np.bool_)
    work, goal_r, q = workspace(n), np.empty((3, 3)), np.empty(n)
    for k in range(count):
        goal_p = targets[k, :3]
        dx, dy, dz = goal_p[0] - reach[0], goal_p[1] - reach[1], goal_p[2] - reach[2]
        if dx * dx + dy * dy + dz * dz > reach[3] * reach[3]:
            continue
        rotation_of(targets[k, 3:], goal_r)
        nearest = np.inf
        for trial in range(seeds.shape[0] + restarts.shape[0]):
            if trial == few and nearest > FAR * FAR:
                break
            at = trial - seeds.shape[0]
            for i in range(n):
                start = seeds[trial, i] if at < 0 else restarts[at, i]
                q[i] = min(max(start, chain[3][i]), chain[4][i])
            if descend(chain, goal_r, goal_p, q, iterations, tolerance, work):
                for i in range(n):
                    out[k, i] = q[i]
                ok[k] = True
                break
            nearest = min(nearest, np.sum(work[5] ** 2))
    return out, ok


@kernel
def solve_path(chain, poses, start, iterations, tolerance, jump):
    """Joints (K,n) along poses (K,7), and how many before a jump."""
    count, n = poses.shape[0], start.shape[0]
    out, work, goal_r, q = np.empty((count, n)), workspace(n), np.empty((3, 3)), start.copy()
    before = start
    for k in range(count):
        rotation_of(poses[k, 3:], goal_r)
        if not descend(chain, goal_r, poses[k, :3], q, iterations, tolerance, work):
            return out, k
        for i in range(n):
            if abs(q[i] - before[i]) > jump:
                return out, k
            out[k, i] = q[i]
        before = out[k]
    return out, count
