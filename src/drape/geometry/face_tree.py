"""The face of a body that is nearest to each point, compiled: a tree of boxes, and on which side points are.

Libraries build a tree from scratch for a body that has moved, and know nothing of a point but its place. Here each
point is first asked about the face of the one before it, which bounds what has to be looked at.
"""

from __future__ import annotations

import math

import numpy as np

from drape.compiled import compiled, inlined

LEAF = 4
"""Faces in a box that is not divided further, at most."""
DEEPEST = 64
"""Boxes that wait, at most; a tree of 2^63 leaves needs no more."""
TINY = np.finfo(np.float64).tiny


@inlined
def _minus(a, b):
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@inlined
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inlined
def _cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inlined
def _scaled(a, by):
    return a[0] * by, a[1] * by, a[2] * by


@inlined
def _row(x, i):
    return x[i, 0], x[i, 1], x[i, 2]


@inlined
def _triangle(corners, f):
    return _row(corners[f], 0), _row(corners[f], 1), _row(corners[f], 2)


@inlined
def _on_segment(p, a, b):
    """Share of the way from a to b at which p is nearest, and the squared distance."""
    way, arm = _minus(b, a), _minus(p, a)
    share = _dot(arm, way) / max(_dot(way, way), TINY)
    share = min(max(share, 0.0), 1.0)
    gap = _minus(arm, _scaled(way, share))
    return share, _dot(gap, gap)


@inlined
def _closest(p, a, b, c):
    """As :func:`drape.geometry.triangles.closest_on_triangles`, with the squared distance."""
    first, last, arm = _minus(b, a), _minus(a, c), _minus(p, a)
    normal = _cross(first, _minus(c, b))
    square = _dot(normal, normal)
    if square > 0.0:
        w2 = _dot(_cross(first, arm), normal) / square
        w1 = _dot(_cross(last, _minus(p, c)), normal) / square
        height = _dot(arm, normal)
        if w1 > 0.0 and w2 > 0.0 and 1.0 - w1 - w2 > 0.0:
            return (1.0 - w1 - w2, w1, w2), height * height / square
    share, best = _on_segment(p, a, b)
    weights = (1.0 - share, share, 0.0)
    share, found = _on_segment(p, b, c)
    if found < best:
        best, weights = found, (0.0, 1.0 - share, share)
    share, found = _on_segment(p, c, a)
    if found < best:
        best, weights = found, (share, 0.0, 1.0 - share)
    return weights, best


@inlined
def _select(order, keys, first, last, middle):
    """Reorder ``order[first:last]`` so that what stands before ``middle`` has no larger key than what stands there."""
    low, high = first, last - 1
    while low < high:
        pivot, i, j = keys[order[(low + high) // 2]], low, high
        while i <= j:
            while keys[order[i]] < pivot:
                i += 1
            while keys[order[j]] > pivot:
                j -= 1
            if i <= j:
                order[i], order[j] = order[j], order[i]
                i, j = i + 1, j - 1
        if j < middle < i:
            break
        low, high = (low, j) if middle <= j else (i, high)


@inlined
def _leaves(count):
    """Number of leaves of a tree of so many faces, a power of two."""
    leaves = 1
    while leaves * LEAF < count:
        leaves *= 2
    return leaves


@compiled
def halved(corners):
    """The faces [F, 3, 3] leaf after leaf: all are cut into halves across the longest side of their box, and so on."""
    leaves = _leaves(len(corners))
    order, centres = np.arange(len(corners)), np.empty((3, len(corners)))
    for f in range(len(corners)):
        for axis in range(3):
            centres[axis, f] = corners[f, 0, axis] + corners[f, 1, axis] + corners[f, 2, axis]
    parts = 1
    while parts < leaves:
        for part in range(parts):
            first, last = part * len(order) // parts, (part + 1) * len(order) // parts
            longest, side = 0, -1.0
            for axis in range(3):
                low, high = np.inf, -np.inf
                for place in range(first, last):
                    at = centres[axis, order[place]]
                    low, high = min(low, at), max(high, at)
                if high - low > side:
                    longest, side = axis, high - low
            _select(order, centres[longest], first, last, (2 * part + 1) * len(order) // (2 * parts))
        parts *= 2
    return order


@inlined
def _boxes(corners, leaves):
    """Low and high corner of each node: 1 is the root, ``2 n`` and ``2 n + 1`` are below n, leaves are the last."""
    boxes = np.empty((2 * leaves, 6))
    boxes[:, :3], boxes[:, 3:] = np.inf, -np.inf
    for leaf in range(leaves):
        node = leaves + leaf
        for place in range(leaf * len(corners) // leaves, (leaf + 1) * len(corners) // leaves):
            for corner in range(3):
                for axis in range(3):
                    at = corners[place, corner, axis]
                    boxes[node, axis] = min(boxes[node, axis], at)
                    boxes[node, 3 + axis] = max(boxes[node, 3 + axis], at)
    for node in range(leaves - 1, 0, -1):
        for axis in range(3):
            boxes[node, axis] = min(boxes[2 * node, axis], boxes[2 * node + 1, axis])
            boxes[node, 3 + axis] = max(boxes[2 * node, 3 + axis], boxes[2 * node + 1, 3 + axis])
    return boxes


@inlined
def _to_box(p, boxes, node):
    """Squared distance."""
    x = max(boxes[node, 0] - p[0], p[0] - boxes[node, 3], 0.0)
    y = max(boxes[node, 1] - p[1], p[1] - boxes[node, 4], 0.0)
    z = max(boxes[node, 2] - p[2], p[2] - boxes[node, 5], 0.0)
    return x * x + y * y + z * z


@compiled
def closest_of_tree(points, corners, order):
    """Number of the face [F, 3, 3] that is closest to each point [N, 3]; -1 where none is at a finite distance.

    ``order``: of the faces in the tree, by :func:`halved`. That of a body some frames before is as good.
    """
    leaves, guess = _leaves(len(corners)), 0
    sorted_corners = corners[order]
    boxes = _boxes(sorted_corners, leaves)
    found = np.full(len(points), -1)
    nodes, bounds = np.empty(DEEPEST, np.int64), np.empty(DEEPEST)
    for i in range(len(points)):
        p = _row(points, i)
        _, best = _closest(p, *_triangle(sorted_corners, guess))
        if not best < np.inf:
            continue
        face, waiting = guess, 1
        nodes[0], bounds[0] = 1, 0.0
        while waiting > 0:
            waiting -= 1
            node = nodes[waiting]
            if bounds[waiting] >= best:
                continue
            if node < leaves:
                near, far = 2 * node, 2 * node + 1
                to_near, to_far = _to_box(p, boxes, near), _to_box(p, boxes, far)
                if to_far < to_near:
                    near, far, to_near, to_far = far, near, to_far, to_near
                nodes[waiting], bounds[waiting] = far, to_far
                waiting += to_far < best
                nodes[waiting], bounds[waiting] = near, to_near
                waiting += to_near < best
                continue
            leaf = node - leaves
            for place in range(leaf * len(order) // leaves, (leaf + 1) * len(order) // leaves):
                _, square = _closest(p, *_triangle(sorted_corners, place))
                if square < best:
                    best, face = square, place
        guess = face
        found[i] = order[face]
    return found


@inlined
def _around(faces, num_vertices):
    """The faces at each vertex, one vertex after the other, and where those of each begin."""
    first = np.zeros(num_vertices + 1, np.int64)
    for corner in faces.flat:
        first[corner + 1] += 1
    for vertex in range(num_vertices):
        first[vertex + 1] += first[vertex]
    place, found = first.copy(), np.empty(faces.size, np.int64)
    for f in range(len(faces)):
        for corner in range(3):
            found[place[faces[f, corner]]] = f
            place[faces[f, corner]] += 1
    return first, found


@inlined
def _angle(w, corners):
    """The angle that a face spans around a point of it: 2π inside, π on a side, that of the corner on a corner."""
    zeros = (w[0] == 0.0) + (w[1] == 0.0) + (w[2] == 0.0)
    if zeros < 2:
        return math.pi if zeros == 1 else 2.0 * math.pi
    corner = 0 if w[0] > 0.0 else (1 if w[1] > 0.0 else 2)
    apex = _row(corners, corner)
    left, right = _minus(_row(corners, (corner + 1) % 3), apex), _minus(_row(corners, (corner + 2) % 3), apex)
    across = _cross(left, right)
    return math.atan2(math.sqrt(_dot(across, across)), _dot(left, right))


@inlined
def _asked(p, corners):
    """Distance from a face, how high above its plane, the angle that it spans around the closest point, its size."""
    a, b, c = _row(corners, 0), _row(corners, 1), _row(corners, 2)
    first, second, third = _minus(b, a), _minus(c, b), _minus(a, c)
    size = max(_dot(first, first), _dot(second, second), _dot(third, third))
    normal = _cross(first, second)
    w, square = _closest(p, a, b, c)
    height = _dot(_minus(p, a), normal) / math.sqrt(_dot(normal, normal))
    return math.sqrt(square), height, _angle(w, corners), math.sqrt(size)


@compiled
def sided(points, corners, faces, closest, num_vertices, tie):
    """Of the faces with the same closest point the one that faces each point most directly, on the side where it is.

    Returns the face, its barycentric coordinates, and the distance, negative inside: see :class:`NearestFaces`.
    """
    first, around = _around(faces, num_vertices)
    most = np.max(first[1:] - first[:-1])
    distance, height, angle, size = np.empty(most), np.empty(most), np.empty(most), np.empty(most)
    barycentric, signed = np.empty((len(points), 3)), np.empty(len(points))
    face = closest.copy()
    for i in range(len(points)):
        p, f = _row(points, i), closest[i]
        w, _ = _closest(p, _row(corners[f], 0), _row(corners[f], 1), _row(corners[f], 2))
        corner = 0 if w[0] >= w[1] and w[0] >= w[2] else (1 if w[1] >= w[2] else 2)
        start = first[faces[f, corner]]
        count = 1 if w[0] > 0.0 and w[1] > 0.0 and w[2] > 0.0 else first[faces[f, corner] + 1] - start
        best, outward, highest = np.inf, 0.0, -np.inf
        for k in range(count):
            each = f if count == 1 else around[start + k]
            distance[k], height[k], angle[k], size[k] = _asked(p, corners[each])
            best = min(best, distance[k])
        for k in range(count):
            outward += angle[k] * height[k] if distance[k] <= best + tie * size[k] else 0.0
        sign = -1.0 if outward < 0.0 else 1.0
        for k in range(count):
            if distance[k] <= best + tie * size[k] and sign * height[k] > highest:
                highest, face[i] = sign * height[k], f if count == 1 else around[start + k]
        f = face[i]
        w, _ = _closest(p, _row(corners[f], 0), _row(corners[f], 1), _row(corners[f], 2))
        barycentric[i, 0], barycentric[i, 1], barycentric[i, 2] = w
        signed[i] = sign * best
    return face, barycentric, signed


@compiled
def frames(corners, barycentric):
    """A point of each face [N, 3, 3] with two tangents and the normal there; 0 where the face has no area."""
    point, tangents, normals = np.empty((len(corners), 3)), np.empty((len(corners), 2, 3)), np.empty((len(corners), 3))
    for i in range(len(corners)):
        a, b, c = _row(corners[i], 0), _row(corners[i], 1), _row(corners[i], 2)
        side, normal = _minus(b, a), _cross(_minus(b, a), _minus(c, a))
        side = _scaled(side, 1.0 / max(math.sqrt(_dot(side, side)), 1e-30))
        normal = _scaled(normal, 1.0 / max(math.sqrt(_dot(normal, normal)), 1e-30))
        other = _cross(normal, side)
        for axis in range(3):
            point[i, axis] = barycentric[i, 0] * a[axis] + barycentric[i, 1] * b[axis] + barycentric[i, 2] * c[axis]
            tangents[i, 0, axis], tangents[i, 1, axis], normals[i, axis] = side[axis], other[axis], normal[axis]
    return point, tangents, normals
