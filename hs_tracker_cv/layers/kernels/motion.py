"""How things move: what motion to expect, what the flow and registration make of it, where to search."""

# Parts have no types of their own: Numba infers them.
# mypy: allow-untyped-defs, no-check-untyped-defs, allow-untyped-calls
from __future__ import annotations

import numpy as np

from ...compiling import larger, local, root, smaller
from .common import FAR_OFF, KNOWN, Image, Integers, Mask, Masks, Numbers, Plane, fast_kernel, fast_part, select
from .registration import collect, every, fit_affine, gauss_newton, residual
from .shapes import widen

f32 = np.float32
_NEVER_OBJECT = np.float32(-2.9)  # log-odds: what lies below has been ground for many frames
_FIT_PIXELS = 1200  # enough for eight parameters; more only cost time
_GROUND_PIXELS = 1000
_FEWEST = 60  # fewer pixels say nothing about the camera
_NEAR = 2  # px round the object in which the flow may be its own
_FAR = 1 << 20  # px, more than anything moves: what is added to it is positive
_CONTINUE = 1.03  # the motion found from the predicted one wins where it explains the frame about as well

_two = local(2)
_three = local(3)
_four = local(4)
_eight = local(8)
_twelve = local(12)


@fast_part
def outline(odds, visible, way, obj, weight, sums):
    """Mask of the object {odds > 0}, the weight of its pixels, and where it is.

    `way` tells what they weigh: 0 one; 1 their odds, at most one; 2 what `visible` says. `sums` receives the area and
    the sums of x and of y, then first and last column and row of the object (4), and the same of all that may
    belong to it (4), and the sum of the weights.
    """
    h, w = odds.shape
    left = may_left = w
    right = may_right = -1
    top = may_top = h
    bottom = may_bottom = -1
    area = sum_x = sum_y = 0
    total = f32(0.0)
    for y in range(h):
        inside = across = 0
        low = may_low = w
        high = may_high = -1
        for x in range(w):
            s = odds[y, x]
            own = 1 if s > f32(0.0) else 0
            inside += own
            across += own * x
            low = smaller(low, x if s > f32(0.0) else w)
            high = larger(high, x if s > f32(0.0) else -1)
            may_low = smaller(may_low, x if s > _NEVER_OBJECT else w)
            may_high = larger(may_high, x if s > _NEVER_OBJECT else -1)
        area += inside
        sum_x += across
        sum_y += inside * y
        if inside > 0:
            top = smaller(top, y)
            bottom = y
            left = smaller(left, low)
            right = larger(right, high)
        if may_high >= 0:
            may_top = smaller(may_top, y)
            may_bottom = y
            may_left = smaller(may_left, may_low)
            may_right = larger(may_right, may_high)
        for x in range(w):
            obj[y, x] = 1 if odds[y, x] > f32(0.0) else 0
        for x in range(w):
            s = odds[y, x]
            value = f32(1.0) if s > f32(0.0) else f32(0.0)
            value = smaller(larger(s, f32(0.0)), f32(1.0)) if way == 1 else value
            value = f32(visible[y, x]) if way == 2 else value
            value = (
                smaller(larger(s, f32(0.0)), f32(1.0)) * f32(visible[y, x]) * f32(1.0 / 255.0) if way == 3 else value
            )
            weight[y, x] = value
            total += value
    sums[0] = area
    sums[1] = sum_x
    sums[2] = sum_y
    sums[3] = left
    sums[4] = right
    sums[5] = top
    sums[6] = bottom
    sums[7] = may_left
    sums[8] = may_right
    sums[9] = may_top
    sums[10] = may_bottom
    sums[11] = total


@fast_part
def _affine(velocity_x, velocity_y, linear, scale, theta):
    """Write a motion of the object, in window px, into theta."""
    theta[0] = velocity_x
    theta[3] = velocity_y
    for i in range(2):
        theta[1 + i] = linear[i] * scale
        theta[4 + i] = linear[2 + i] * scale
    theta[6] = theta[7] = 0.0


@fast_kernel
def start_flow(near: Mask, grid: Numbers, theta: Numbers, camera: Numbers, out: Image) -> None:
    """Flow to start from, into out (h, w, 2): the affine motion where `near` is set, the camera's elsewhere."""
    h, w = near.shape
    for y in range(h):
        yy = (y - grid[1]) / grid[2]
        for x in range(w):
            if near[y, x] != 0:
                xx = (x - grid[0]) / grid[2]
                out[y, x, 0] = theta[0] + theta[1] * xx + theta[2] * yy
                out[y, x, 1] = theta[3] + theta[4] * xx + theta[5] * yy
            else:
                out[y, x, 0] = camera[0]
                out[y, x, 1] = camera[1]


@fast_kernel
def foresee(
    odds: Plane,
    visible: Mask,
    way: int,
    box: Numbers,
    obj: Image,
    image: Image,
    inside: Integers,
    motion: Numbers,
    camera: Numbers,
    known: bool,
    masks: Masks,
    weight: Plane,
    points: Plane,
    sums: Numbers,
    theta: Numbers,
    flow: Image,
) -> tuple[int, float]:
    """Outline of the object before this frame, and what motion to expect: what has to be known before the flow is.

    Parameters
    ----------
    odds, visible, way
        See :func:`outline`.
    box
        Grid to fall back on, (cx, cy, scale, area), when there is no outline.
    obj, image, inside
        Object layer and current image.
    motion, camera
        Velocity (2) and linear part (4) of the object and velocity (2) of the camera in the last frame.
    known
        The object moves by its velocity, whatever the image says.
    masks
        (3, h, w); receives the mask, the same widened, and is a workspace.
    weight, points
        Receive the weights and the points of :func:`collect`.
    sums
        Receives the grid of the object (cx, cy, scale, area), the sum of its weights, and (x0, y0, x1, y1) of all
        that may belong to it.
    theta, flow
        Receive the motion and the flow to start from.

    Returns
    -------
    Number of points, and the mean residual of the motion (0 if it is known).
    """
    mask = masks[0]
    found = _twelve()
    outline(odds, visible, way, mask, weight, found)
    area = found[0]
    for i in range(4):
        sums[i] = box[i]
    if area >= 4:
        sums[0] = found[1] / area
        sums[1] = found[2] / area
        sums[2] = larger(6.0, 0.5 * larger(found[4] - found[3] + 1, found[6] - found[5] + 1))
        sums[3] = area
    sums[4] = found[11]
    sums[5] = found[7]
    sums[6] = found[9]
    sums[7] = found[8] + 1
    sums[8] = found[10] + 1
    scale = sums[2]
    near = masks[1]
    widen(mask, _NEAR, masks[2], near)
    count = collect(obj, weight, sums, every(sums[3], _FIT_PIXELS), points)
    none = _four()
    for i in range(4):
        none[i] = 0.0
    cost = 0.0
    if known:
        _affine(motion[0], motion[1], none, scale, theta)
    else:
        linear = _four()
        bent = 0.0
        for i in range(4):
            linear[i] = motion[2 + i]
            bent = larger(bent, abs(linear[i]))
        _affine(motion[0], motion[1], linear, scale, theta)
        cost = residual(image, points, count, theta, FAR_OFF, inside)
        other = _eight()
        for candidate in range(0 if bent * scale > 0.02 else 1, 2):
            vx = camera[0] if candidate else motion[0]
            vy = camera[1] if candidate else motion[1]
            dx = vx - theta[0]
            dy = vy - theta[3]
            if candidate == 1 and dx * dx + dy * dy < 0.01:
                continue
            _affine(vx, vy, none, scale, other)
            other_cost = residual(image, points, count, other, FAR_OFF, inside)
            if other_cost < cost - 0.3:
                cost = other_cost
                for i in range(8):
                    theta[i] = other[i]
    start_flow(near, sums, theta, camera, flow)
    return count, cost


@fast_part
def _camera(flow, near, last, sample, camera):
    """Median flow outside the object, into camera[0..1]; looked at are every fourth pixel of every fourth row.

    It is exactly zero when it is small, the `last` one when hardly anything is outside. `sample` is a workspace.
    """
    h, w = near.shape
    n = 0
    for y in range(0, h, 4):
        for x in range(y // 4 % 4, w, 4):
            if near[y, x] == 0 and n < sample.shape[1]:
                sample[0, n] = flow[y, x, 0]
                sample[1, n] = flow[y, x, 1]
                n += 1
    for i in range(2):
        camera[i] = select(sample[i], n, 0.5) if 16 * n >= _FEWEST else last[i]
    if 16 * n >= _FEWEST and camera[0] * camera[0] + camera[1] * camera[1] < 0.0144:
        camera[0] = camera[1] = 0.0


@fast_part
def _ground(image, atlas, counts, near, camera, offset, noise, inside, steps, used, points, best):
    """Find where the atlas lies in this frame, and its brightness, into `best` as :func:`gauss_newton` has it.

    Against the atlas, not the previous frame, so that errors don't add up. "The camera stood still" wins ties:
    otherwise noise slowly blurs the atlas. `used` and `points` are workspaces.
    """
    h, w = near.shape
    area = 0
    for y in range(h):
        for x in range(w):
            free = near[y, x] == 0 and counts[0, y, x] >= KNOWN
            used[y, x] = f32(1.0) if free else f32(0.0)
            area += 1 if free else 0
    grid = _three()
    grid[0] = 0.5 * w
    grid[1] = 0.5 * h
    grid[2] = 0.5 * larger(h, w)
    count = collect(atlas, used, grid, every(area, _GROUND_PIXELS), points)
    still = _eight()
    start = _eight()
    prior = _eight()
    costs = _two()
    for i in range(8):
        still[i] = start[i] = 0.0
        prior[i] = 1e6
    for i in range(2):
        still[3 * i] = start[3 * i] = offset[i]
        prior[3 * i] = 0.02 * noise * noise
    prior[6] = 1.0
    moved = False
    if camera[0] != 0.0 or camera[1] != 0.0:
        unmoved = residual(image, points, count, still, FAR_OFF, inside)
        for i in range(2):
            start[3 * i] = offset[i] + camera[i]
        moved = residual(image, points, count, start, FAR_OFF, inside) < unmoved
        if not moved:
            for i in range(2):
                start[3 * i] = offset[i]
    for i in range(8):
        best[i] = start[i]
    gauss_newton(image, points, count, best, prior, 3.0 * noise, FAR_OFF, inside, costs, steps, 0.0)
    dx = best[0] - start[0]
    dy = best[3] - start[3]
    cost = costs[1]
    if not (costs[1] <= costs[0] and dx * dx + dy * dy < 4.0):
        cost = costs[0]
        for i in range(8):
            best[i] = start[i]
        if not moved:
            return
    still[6] = best[6]
    if residual(image, points, count, still, FAR_OFF, inside) <= 1.03 * cost + 0.02:
        for i in range(8):
            best[i] = still[i]


@fast_part
def _settled(new, old):
    """Offset of the atlas: on a whole pixel where it nearly is, and was before."""
    whole = np.int64(new + _FAR + 0.5) - _FAR
    return 1.0 * whole if abs(new - whole) < 0.08 and abs(new - old) < 0.15 else new


@fast_part
def _object(image, points, count, fitted, predicted, scale, noise, hidden, young, inside, steps, best):
    """Sharpen the fit of the flow against the object layer, into `best`.

    The fit follows the frame pair, the layer keeps it from drifting. Registration starts from the fit and from the
    prediction, and is believed only near its start.
    """
    least = larger(noise, 2.0)
    strength = least * least * (5.0 if hidden else 1.0)
    prior = _eight()
    theta = _eight()
    costs = _two()
    for i in range(8):
        prior[i] = 0.05 * strength
        best[i] = fitted[i]
    prior[0] = prior[3] = prior[7] = 0.02 * strength
    prior[6] = 0.02
    # what differs by more than the fit takes seriously (a highlight, something in front) must not decide either
    serious = 3.0 * noise + 3.0
    limit = 0.0
    for attempt in range(2):
        start = predicted if attempt else fitted
        if attempt == 1 and larger(abs(start[0] - fitted[0]), abs(start[3] - fitted[3])) < 0.05:
            continue
        for i in range(8):
            theta[i] = start[i]
        gauss_newton(
            image,
            points,
            count,
            theta,
            prior,
            serious,
            serious,
            inside,
            costs,
            steps,
            1.0 * strength if young else 0.0,
        )
        if attempt == 0:
            limit = costs[0]
        dx = theta[0] - start[0]
        dy = theta[3] - start[3]
        stretched = larger(larger(abs(theta[1]), abs(theta[2])), larger(abs(theta[4]), abs(theta[5])))
        if dx * dx + dy * dy > 9.0 or stretched > 0.4 * scale:
            continue
        if costs[1] < (_CONTINUE * limit if attempt else limit):
            limit = costs[1]
            for i in range(8):
                best[i] = theta[i]


@fast_kernel
def measure(
    flow: Image,
    image: Image,
    previous: Plane,
    inside: Integers,
    near: Mask,
    camera: Numbers,
    noise: float,
    atlas: Image,
    counts: Image,
    offset: Numbers,
    ground_steps: int,
    odds: Plane,
    weight: Plane,
    grid: Numbers,
    points: Plane,
    count: int,
    predicted: Numbers,
    hidden: bool,
    young: bool,
    steps: int,
    used: Plane,
    spare: Plane,
    ground: Numbers,
    theta: Numbers,
) -> None:
    """Motion of the camera and of the object in this frame, by the flow and by registration with both layers.

    Parameters
    ----------
    flow, image, previous, inside
        This frame; `previous` is the last one, in gray.
    near, odds, weight, grid, points, count, predicted
        The object as :func:`foresee` has it. Without points only the camera's motion is measured.
    camera
        Velocity (2) of the camera in the last frame.
    noise
        Gray levels.
    atlas, counts, offset
        The background and where it was in the last frame.
    ground_steps, steps
        Most steps of :func:`gauss_newton` for camera and object.
    hidden, young
        Something is in front of the object; its motion is still little known.
    used, spare
        Workspaces, (h, w) and the size of `points`.
    ground, theta
        Receive the motion of the atlas to this frame, and that of the object since the last.
    """
    moved = _two()
    _camera(flow, near, camera, spare, moved)
    _ground(image, atlas, counts, near, moved, offset, noise, inside, ground_steps, used, spare, ground)
    for i in range(2):
        ground[3 * i] = _settled(ground[3 * i], offset[i])
        moved[i] = ground[3 * i] - offset[i]
    if count == 0:
        return
    fitted = _eight()
    ridge = _three()
    for i in range(8):
        fitted[i] = predicted[i]
    for i in range(3):
        ridge[i] = (0.9 if hidden else 0.03) if i else (0.018 if hidden else 0.006)
    stride = every(grid[3], _FIT_PIXELS)
    fit_affine(flow, previous, odds, weight, grid, ridge, noise, moved, young, stride, spare, fitted)
    limit = 0.0 if hidden else 0.35 * grid[2]
    for i in range(1, 6):
        if i != 3:
            fitted[i] = smaller(larger(fitted[i], -limit), limit)
    _object(image, points, count, fitted, predicted, grid[2], noise, hidden, young, inside, steps, theta)


@fast_kernel
def search_shift(
    image: Image,
    obj: Image,
    shape: Plane,
    different: Mask,
    centre: Integers,
    reach: int,
    step: int,
    inside: Integers,
    noise: float,
) -> tuple[float, float, int, int]:
    """Best translation of the object layer: Σ over its shape of [not background] (1 − min(|I − O| / (12 + 3σ), 2)).

    Shifts are `centre` ± `reach` in steps of `step` px; about four hundred pixels of {shape > ½} are looked at.
    Returns (score there, score at no shift, dx, dy), scores per pixel of the shape.
    """
    h, w, channels = image.shape
    area = 0
    for y in range(h):
        for x in range(w):
            if shape[y, x] > 0.5:
                area += 1
    stride = larger(1, np.int64(root(area / 400.0)))
    best = -1e9
    still = 0.0
    best_x = 0
    best_y = 0
    unit = 1.0 / ((12.0 + 3.0 * noise) * channels)
    for sy in range(centre[1] - reach, centre[1] + reach + 1, step):
        for sx in range(centre[0] - reach, centre[0] + reach + 1, step):
            score = 0.0
            n = 0
            for y in range(0, h, stride):
                for x in range(0, w, stride):
                    if shape[y, x] <= 0.5:
                        continue
                    n += 1
                    qx = x + sx
                    qy = y + sy
                    if qx < inside[0] or qy < inside[1] or qx >= inside[2] or qy >= inside[3]:
                        continue
                    if different[qy, qx] == 0:
                        continue
                    e = 0.0
                    for c in range(channels):
                        e += abs(image[qy, qx, c] - obj[y, x, c])
                    score += 1.0 - smaller(e * unit, 2.0)
            score /= larger(n, 1)
            if sx == 0 and sy == 0:
                still = score
            if score > best:
                best = score
                best_x = sx
                best_y = sy
    return best, still, best_x, best_y
