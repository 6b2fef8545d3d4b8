"""Numba kernels of collision checking between convex pieces: a core swept by a ball.

Gilbert-Johnson-Keerthi (van den Bergen, 2003) with an early end; closest points of a simplex:
Ericson, 2005, 5.1. Transforms are rows of 12, rotation by rows, then translation.
"""

import numpy as np
from numba import njit

kernel = njit(cache=True, error_model="numpy")
BOX, CYLINDER, SEGMENT, POINTS = 0, 1, 2, 3
MAX_ITERATIONS = 40


@kernel
def chain_transforms(a, i, b, j, out, k):
    """Write a[i] b[j] into out[k]; slices cost more than the work."""
    for r in range(3):
        x, y, z = a[i, 3 * r], a[i, 3 * r + 1], a[i, 3 * r + 2]
        out[k, 3 * r] = x * b[j, 0] + y * b[j, 3] + z * b[j, 6]
        out[k, 3 * r + 1] = x * b[j, 1] + y * b[j, 4] + z * b[j, 7]
        out[k, 3 * r + 2] = x * b[j, 2] + y * b[j, 5] + z * b[j, 8]
        out[k, 9 + r] = x * b[j, 9] + y * b[j, 10] + z * b[j, 11] + a[i, 9 + r]


@kernel
def place_frames(parent, origin, prismatic, q, row, out):
    """Write world transforms (F+1,12) of world and joint frames."""
    out[0] = 0.0
    out[0, 0] = out[0, 4] = out[0, 8] = 1.0
    for f in range(parent.shape[0]):
        k = f + 1
        chain_transforms(out, parent[f], origin, f, out, k)
        if prismatic[f]:
            for r in range(3):
                out[k, 9 + r] += out[k, 3 * r + 2] * q[row, f]
        else:
            c, s = np.cos(q[row, f]), np.sin(q[row, f])
            for r in range(3):
                x, y = out[k, 3 * r], out[k, 3 * r + 1]
                out[k, 3 * r], out[k, 3 * r + 1] = x * c + y * s, y * c - x * s


@kernel
def support(core, size, points, t, p, dx, dy, dz):
    """Farthest point of the core of piece p, placed by t[p], in a world direction."""
    lx = t[p, 0] * dx + t[p, 3] * dy + t[p, 6] * dz
    ly = t[p, 1] * dx + t[p, 4] * dy + t[p, 7] * dz
    lz = t[p, 2] * dx + t[p, 5] * dy + t[p, 8] * dz
    kind, px, py = core[p, 0], 0.0, 0.0
    pz = size[p, 2] if lz >= 0 else -size[p, 2]
    if kind == BOX:
        px = size[p, 0] if lx >= 0 else -size[p, 0]
        py = size[p, 1] if ly >= 0 else -size[p, 1]
    elif kind == CYLINDER:
        rim = np.sqrt(lx * lx + ly * ly)
        scale = size[p, 0] / rim if rim > 1e-12 else 0.0
        px, py = lx * scale, ly * scale
    elif kind == POINTS:
        best, at = -np.inf, core[p, 1]
        for k in range(core[p, 1], core[p, 2]):
            d = points[k, 0] * lx + points[k, 1] * ly + points[k, 2] * lz
            if d > best:
                best, at = d, k
        px, py, pz = points[at, 0], points[at, 1], points[at, 2]
    return (
        t[p, 0] * px + t[p, 1] * py + t[p, 2] * pz + t[p, 9],
        t[p, 3] * px + t[p, 4] * py + t[p, 5] * pz + t[p, 10],
        t[p, 6] * px + t[p, 7] * py + t[p, 8] * pz + t[p, 11],
    )


@kernel
def dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel
def closest_on_triangle(s, i, j, k, weights):
    """Write the weights (3,) of a triangle's point closest to the origin (5.1.5)."""
    abx, aby, abz = s[j, 0] - s[i, 0], s[j, 1] - s[i, 1], s[j, 2] - s[i, 2]
    acx, acy, acz = s[k, 0] - s[i, 0], s[k, 1] - s[i, 1], s[k, 2] - s[i, 2]
    d1 = -(abx * s[i, 0] + aby * s[i, 1] + abz * s[i, 2])
    d2 = -(acx * s[i, 0] + acy * s[i, 1] + acz * s[i, 2])
    d3 = -(abx * s[j, 0] + aby * s[j, 1] + abz * s[j, 2])
    d4 = -(acx * s[j, 0] + acy * s[j, 1] + acz * s[j, 2])
    d5 = -(abx * s[k, 0] + aby * s[k, 1] + abz * s[k, 2])
    d6 = -(acx * s[k, 0] + acy * s[k, 1] + acz * s[k, 2])
    vc, vb, va = d1 * d4 - d3 * d2, d5 * d2 - d1 * d6, d3 * d6 - d5 * d4
    if d1 <= 0 and d2 <= 0:
        weights[0], weights[1], weights[2] = 1.0, 0.0, 0.0
    elif d3 >= 0 and d4 <= d3:
        weights[0], weights[1], weights[2] = 0.0, 1.0, 0.0
    elif d6 >= 0 and d5 <= d6:
        weights[0], weights[1], weights[2] = 0.0, 0.0, 1.0
    elif vc <= 0 and d1 >= 0 and d3 <= 0:
        v = d1 / (d1 - d3)
        weights[0], weights[1], weights[2] = 1.0 - v, v, 0.0
    elif vb <= 0 and d2 >= 0 and d6 <= 0:
        w = d2 / (d2 - d6)
        weights[0], weights[1], weights[2] = 1.0 - w, 0.0, w
    elif va <= 0 and d4 - d3 >= 0 and d5 - d6 >= 0:
        w = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        weights[0], weights[1], weights[2] = 0.0, 1.0 - w, w
    else:
        total = va + vb + vc
        weights[0], weights[1], weights[2] = va / total, vb / total, vc / total


@kernel
def origin_outside(s, i, j, k, opposite):
    """Whether the plane parts the origin from s[opposite], or all is flat."""
    ax, ay, az = s[j, 0] - s[i, 0], s[j, 1] - s[i, 1], s[j, 2] - s[i, 2]
    bx, by, bz = s[k, 0] - s[i, 0], s[k, 1] - s[i, 1], s[k, 2] - s[i, 2]
    nx, ny, nz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    towards_origin = -(nx * s[i, 0] + ny * s[i, 1] + nz * s[i, 2])
    x, y, z = s[opposite, 0] - s[i, 0], s[opposite, 1] - s[i, 1], s[opposite, 2] - s[i, 2]
    return towards_origin * (nx * x + ny * y + nz * z) <= 0.0


@kernel
def keep(s, count, weights, v):
    """Drop points of weight zero, write the weighted point into v (3,); the new count."""
    v[0] = v[1] = v[2] = 0.0
    kept = 0
    for i in range(count):
        if weights[i] > 0.0:
            for c in range(3):
                v[c] += weights[i] * s[i, c]
                s[kept, c] = s[i, c]
            kept += 1
    return kept


@kernel
def reduce_simplex(s, count, weights, trial, v):
    """Write the point nearest to the origin into v; its number of points."""
    weights[:] = 0.0
    if count == 1:
        weights[0] = 1.0
    elif count == 2:
        x, y, z = s[1, 0] - s[0, 0], s[1, 1] - s[0, 1], s[1, 2] - s[0, 2]
        length = x * x + y * y + z * z
        along = -(x * s[0, 0] + y * s[0, 1] + z * s[0, 2]) / length if length > 0.0 else 0.0
        along = min(max(along, 0.0), 1.0)
        weights[0], weights[1] = 1.0 - along, along
    elif count == 3:
        # not 0, 1, 2: constants are a type of their own, for which numba compiles again
        closest_on_triangle(s, count - 3, count - 2, count - 1, weights)
    else:
        best, inside = np.inf, True
        for face in range(4):
            i, j, k = (face + 1) % 4, (face + 2) % 4, (face + 3) % 4
            if not origin_outside(s, i, j, k, face):
                continue
            inside = False
            closest_on_triangle(s, i, j, k, trial)
            x = trial[0] * s[i, 0] + trial[1] * s[j, 0] + trial[2] * s[k, 0]
            y = trial[0] * s[i, 1] + trial[1] * s[j, 1] + trial[2] * s[k, 1]
            z = trial[0] * s[i, 2] + trial[1] * s[j, 2] + trial[2] * s[k, 2]
            distance = x * x + y * y + z * z
            if distance < best:
                best, weights[face] = distance, 0.0
                weights[i], weights[j], weights[k] = trial[0], trial[1], trial[2]
        if inside:
            return 4
    return keep(s, count, weights, v)


@kernel
def within(core, size, points, t, a, b, reach, s, weights, trial, v):
    """Whether the cores of a and b are at most `reach` m apart; the rest is scratch."""
    for c in range(3):
        v[c] = t[a, 9 + c] - t[b, 9 + c]
    if dot(v, v) < 1e-20:
        v[0] = 1.0
    count = 0
    for _ in range(MAX_ITERATIONS):
        ax, ay, az = support(core, size, points, t, a, -v[0], -v[1], -v[2])
        bx, by, bz = support(core, size, points, t, b, v[0], v[1], v[2])
        wx, wy, wz = ax - bx, ay - by, az - bz
        along, square = v[0] * wx + v[1] * wy + v[2] * wz, dot(v, v)
        if along > 0.0 and along * along > reach * reach * square:
            return False
        if count > 0 and square - along <= 1e-9 * square:
            return square <= reach * reach
        s[count, 0], s[count, 1], s[count, 2] = wx, wy, wz
        count = reduce_simplex(s, count + 1, weights, trial, v)
        if count == 4 or dot(v, v) <= reach * reach + 1e-18:
            return True
    # Rounding made the simplex cycle, which happens only within micrometres of touching.
    return dot(v, v) <= (reach + 1e-5) ** 2


@kernel
def centre_far_from(t, a, half, b, distance):
    """Whether the centre of piece b is over `distance` m from the box half[a]."""
    x, y, z = t[b, 9] - t[a, 9], t[b, 10] - t[a, 10], t[b, 11] - t[a, 11]
    dx = max(abs(t[a, 0] * x + t[a, 3] * y + t[a, 6] * z) - half[a, 0], 0.0)
    dy = max(abs(t[a, 1] * x + t[a, 4] * y + t[a, 7] * z) - half[a, 1], 0.0)
    dz = max(abs(t[a, 2] * x + t[a, 5] * y + t[a, 8] * z) - half[a, 2], 0.0)
    return dx * dx + dy * dy + dz * dz > distance * distance


@kernel
def touching(core, size, half, bound, points, t, a, b, reach, s, weights, trial, v):
    """As `within`, asking cheap bounds first."""
    dx, dy, dz = t[a, 9] - t[b, 9], t[a, 10] - t[b, 10], t[a, 11] - t[b, 11]
    far = bound[a] + bound[b] + reach
    if dx * dx + dy * dy + dz * dz > far * far:
        return False
    if centre_far_from(t, a, half, b, bound[b] + reach):
        return False
    if centre_far_from(t, b, half, a, bound[a] + reach):
        return False
    return within(core, size, points, t, a, b, reach, s, weights, trial, v)


@kernel
def place_balls(frames, frame, balls, out):
    """Write the world centres (O,3) of bounding balls (x, y, z, radius)."""
    for o in range(frame.shape[0]):
        i = frame[o]
        for c in range(3):
            x = frames[i, 9 + c]
            for k in range(3):
                x += frames[i, 3 * c + k] * balls[o, k]
            out[o, c] = x


@kernel
def first_contact(parent, origin, prismatic, pieces, pairs, q):
    """(row, pair) of the first contact over joint rows q (K,F), or (-1, -1)."""
    _, frame, local, core, size, radius, half, bound, points = pieces
    owner_frame, balls, bodies, starts, margin, pair_a, pair_b = pairs
    frames, t = np.empty((parent.shape[0] + 1, 12)), np.empty((frame.shape[0], 12))
    centres, placed = np.empty((owner_frame.shape[0], 3)), np.full(frame.shape[0], -1)
    s, weights, trial, v = np.empty((4, 3)), np.empty(4), np.empty(4), np.empty(3)
    for row in range(q.shape[0]):
        place_frames(parent, origin, prismatic, q, row, frames)
        place_balls(frames, owner_frame, balls, centres)
        for g in range(bodies.shape[0]):
            i, j = bodies[g, 0], bodies[g, 1]
            dx, dy, dz = (
                centres[i, 0] - centres[j, 0],
                centres[i, 1] - centres[j, 1],
                centres[i, 2] - centres[j, 2],
            )
            far = balls[i, 3] + balls[j, 3] + margin[g]
            if dx * dx + dy * dy + dz * dz > far * far:
                continue
            for m in range(starts[g], starts[g + 1]):
                a, b = pair_a[m], pair_b[m]
                for p in (a, b):
                    if placed[p] != row and (frame[p] > 0 or placed[p] < 0):
                        chain_transforms(frames, frame[p], local, p, t, p)
                        placed[p] = row
                reach = radius[a] + radius[b] + margin[g]
                if touching(core, size, half, bound, points, t, a, b, reach, s, weights, trial, v):
                    return row, m
    return -1, -1


@kernel
def place_pieces(frames, frame, local, out):
    """Write world transforms (S,P,12) of pieces from those of their frames (S,F,12)."""
    for row in range(frames.shape[0]):
        for p in range(frame.shape[0]):
            chain_transforms(frames[row], frame[p], local, p, out[row], p)


@kernel
def first_swept_contact(pieces, t, own, at, ball, margin):
    """First row at which pieces from `own` on, at transforms `at` (S,12), are within `margin` m of
    the others, or -1.
    """
    _, _, local, core, size, radius, half, bound, points = pieces
    s, weights, trial, v = np.empty((4, 3)), np.empty(4), np.empty(4), np.empty(3)
    for row in range(at.shape[0]):
        now, placed = t[row], False
        x = at[row, 0] * ball[0] + at[row, 1] * ball[1] + at[row, 2] * ball[2] + at[row, 9]
        y = at[row, 3] * ball[0] + at[row, 4] * ball[1] + at[row, 5] * ball[2] + at[row, 10]
        z = at[row, 6] * ball[0] + at[row, 7] * ball[1] + at[row, 8] * ball[2] + at[row, 11]
        for a in range(own):
            dx, dy, dz = now[a, 9] - x, now[a, 10] - y, now[a, 11] - z
            far = bound[a] + radius[a] + ball[3] + margin
            if dx * dx + dy * dy + dz * dz > far * far:
                continue
            if not placed:
                for k in range(own, core.shape[0]):
                    chain_transforms(at, row, local, k, now, k)
                placed = True
            for b in range(own, core.shape[0]):
                reach = radius[a] + radius[b] + margin
                if touching(
                    core, size, half, bound, points, now, a, b, reach, s, weights, trial, v
                ):
                    return row
    return -1
