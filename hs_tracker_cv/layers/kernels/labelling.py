"""Which pixels are the object: the mask, its log-odds, and what is visible of it."""

# Parts have no types of their own: Numba infers them.
# mypy: allow-untyped-defs, no-check-untyped-defs, allow-untyped-calls
from __future__ import annotations

import numpy as np

from ...compiling import larger, smaller
from .colour import bin_row, likelihood
from .common import KNOWN, Bins, Image, Integers, Mask, Masks, Plane, Runs, fast_kernel, fast_part
from .shapes import (
    RUN_AREA,
    RUN_COMMON,
    RUN_END,
    RUN_FIRST,
    RUN_HEAD,
    RUN_ROW,
    components,
    extremes,
    invert,
    median,
    overlap,
    spread,
    widen,
    widen_cross,
    without,
)

f32 = np.float32

# What is new at a pixel.
_GROWN, _FOREIGN, _HIDING = 1, 2, 3


@fast_part
def _distant(apart, near, smallest, runs, out):
    """Write the components that don't touch `near` and are not tiny."""
    n, _ = components(apart, near, runs)
    for i in range(n):
        head = runs[i, RUN_HEAD]
        if runs[head, RUN_COMMON] == 0 and runs[head, RUN_AREA] >= smallest:
            for x in range(runs[i, RUN_FIRST], runs[i, RUN_END]):
                out[runs[i, RUN_ROW], x] = 1


@fast_part
def _arrivals(fresh, own, before, area, emerging, reach, young, spare, runs, kinds, foreign):
    """Tell where the object has grown from where something else has arrived, which `foreign` shows.

    Only what covers a background seen a moment ago (`fresh`) counts: this excludes ghosts and lifted shadows. What is
    new within `reach` px of the object has grown from it, unless it is too `young` for that; what is new beside the
    distractor of the last frame (`before`) is the distractor. What comes out from behind something (`emerging`) may
    be the object itself.
    """
    h, w = own.shape
    new = spare[1]
    apart = spare[2]
    near = spare[3]
    held = spare[4]
    median(fresh, held, new)
    if without(new, own, apart) == 0 or area == 0:
        return
    widen(own, reach, held, near)
    far = without(apart, near, held)
    if far > 0:
        _distant(apart, near, larger(8.0, 0.02 * area), runs, foreign)
    if before.shape[0] > 0:
        widen(before, 3, held, near)
        for y in range(h):
            for x in range(w):
                foreign[y, x] |= apart[y, x] & near[y, x]
    if not young and far < 0.03 * (h * w):
        for y in range(h):
            for x in range(w):
                kinds[y, x] = own[y, x]
                new[y, x] &= foreign[y, x] ^ 1
        spread(new, reach, held, kinds)
    for y in range(h):
        for x in range(w):
            kinds[y, x] &= new[y, x]
            foreign[y, x] = 0 if emerging else foreign[y, x]
            kinds[y, x] |= foreign[y, x] << 1


@fast_part
def _log_odds(image, warped, evidence, kinds, ratio, trust, bins, out):
    """Log-odds of object after this frame's evidence: 0.9 warped + 0.7 evidence + trust · colour ratio.

    The evidence, its first plane, is changed where something is new. `ratio` is the log-ratio of the colour
    histograms per bin, clipped; `bins` receives each pixel's bin.
    """
    h, w, _ = image.shape
    weight = f32(trust)
    for y in range(h):
        bin_row(image, y, bins)
        for x in range(w):
            e = evidence[0, y, x]
            s = warped[y, x]
            kind = kinds[y, x]
            if kind != 0:
                if kind == _GROWN:
                    e = larger(e, f32(2.0))
                    s = larger(s, f32(-0.5))
                elif kind == _HIDING:
                    e = smaller(e, f32(-2.0))
                    s = smaller(s, f32(-1.0))
                elif s < f32(1.0):
                    e = smaller(e, f32(-1.0))
                evidence[0, y, x] = e
            p = f32(0.9) * s + f32(0.7) * e + weight * ratio[np.int64(bins[y, x])]
            out[y, x] = smaller(larger(p, f32(-5.0)), f32(5.0))


@fast_part
def _open(mask, area, spare):
    """Remove from the mask of a large object what is thinner than 3 px, of a middling one what holds no cross."""
    inverse = spare[1]
    wide = spare[2]
    held = spare[3]
    if area <= 150:
        return
    invert(mask, inverse)
    if area > 800:
        widen(inverse, 1, held, wide)
        invert(wide, inverse)
        widen(inverse, 1, held, mask)
    else:
        widen_cross(inverse, wide)
        invert(wide, inverse)
        widen_cross(inverse, mask)


@fast_part
def _own_component(mask, own, area, runs):
    """Keep the component that overlaps most with where the object was expected, and its parts."""
    n, heads = components(mask, own, runs)
    if heads <= 1:
        return
    best = 0
    for i in range(n):
        if runs[i, RUN_HEAD] == i and runs[i, RUN_COMMON] > runs[best, RUN_COMMON]:
            best = i
    for i in range(n):
        head = runs[i, RUN_HEAD]
        common = runs[head, RUN_COMMON]
        part = common > 0.03 * area and common > 0.5 * runs[head, RUN_AREA]
        if not part and (head != best or common == 0):
            for x in range(runs[i, RUN_FIRST], runs[i, RUN_END]):
                mask[runs[i, RUN_ROW], x] = 0


@fast_part
def _settle(raw, mask, foreign, warped, odds):
    """Write the log-odds, lowered where they are positive outside the mask, and where something else is.

    Returns on how many pixels that is.
    """
    h, w = mask.shape
    others = 0
    for y in range(h):
        for x in range(w):
            p = raw[y, x]
            p = f32(-1.0) if (p > f32(0.0)) & (mask[y, x] == 0) else p
            other = (foreign[y, x] != 0) & (warped[y, x] < f32(1.0))
            odds[y, x] = smaller(p, f32(-2.0)) if other else p
            others += foreign[y, x]
    return others


@fast_part
def _mean_round(image, mask, wanted, y, x):
    """Mean colour of the pixels within 3 px of (x, y) whose value in the mask is `wanted`, and their number."""
    h, w = mask.shape
    s0 = s1 = s2 = f32(0.0)
    n = 0
    for j in range(larger(y - 3, 0), smaller(y + 4, h)):
        for i in range(larger(x - 3, 0), smaller(x + 4, w)):
            if mask[j, i] == wanted:
                n += 1
                s0 += image[j, i, 0]
                s1 += image[j, i, 1]
                s2 += image[j, i, 2]
    share = f32(1.0) / f32(larger(n, 1))
    return s0 * share, s1 * share, s2 * share, n


@fast_part
def _cut_edge(image, background, counts, noise, least, spare, mask, odds):
    """Cut mixed edge pixels that are mostly background: α of I = α o + (1 − α) b, and the odds lowered by it.

    o is the mean of the core's pixels within 3 px, b the background, or, where that was never seen, the mean of the
    pixels well outside within 3 px. Returns whether more than the share `least` of the mask is left; if not, the mask
    is as it was, but not the odds.
    """
    h, w = mask.shape
    kept = spare[0]
    core = spare[1]
    wide = spare[2]
    held = spare[3]
    for reach in range(2, 0, -1):  # of a thin object hardly anything is farther inside
        invert(mask, kept)
        widen(kept, reach, held, wide)
        if invert(wide, core) >= 9:
            break
    widen(mask, 1, held, wide)
    flat = f32(36.0 * noise * noise + 100.0)
    before = after = 0
    for y in range(h):
        for x in range(w):
            if mask[y, x] == 0 or core[y, x] != 0:
                continue
            known = counts[0, y, x] >= KNOWN
            b0 = background[y, x, 0]
            b1 = background[y, x, 1]
            b2 = background[y, x, 2]
            if not known:
                b0, b1, b2, count = _mean_round(image, wide, np.uint8(0), y, x)
                if count == 0:
                    continue
            o0, o1, o2, count = _mean_round(image, core, np.uint8(1), y, x)
            if count == 0:
                continue
            o0 -= b0
            o1 -= b1
            o2 -= b2
            e0 = image[y, x, 0] - b0
            e1 = image[y, x, 1] - b1
            e2 = image[y, x, 2] - b2
            span = o0 * o0 + o1 * o1 + o2 * o2
            if span <= flat:
                continue
            alpha = (o0 * e0 + o1 * e1 + o2 * e2) / span
            rest = e0 * e0 + e1 * e1 + e2 * e2 - alpha * alpha * span
            if alpha < f32(0.7) and rest < f32(0.15) * span:
                odds[y, x] = smaller(odds[y, x], larger(f32(8.0) * (alpha - f32(0.5)), f32(-3.0)))
        for x in range(w):
            left = mask[y, x] if odds[y, x] > f32(0.0) else 0
            kept[y, x] = left
            before += mask[y, x]
            after += left
    if after <= least * before:
        return False
    for y in range(h):
        for x in range(w):
            mask[y, x] = kept[y, x]
    return True


@fast_part
def _crossing(values, n, last, step):
    """Edge, px, where the profile crosses zero between the last pixel inside and the next one."""
    edge = last + 0.5 + 0.5 * step
    beyond = last + step
    if beyond < 0 or beyond >= n or values[last] <= f32(0.0) or values[beyond] >= f32(0.0):
        return edge
    inner = 1.0 * values[last]
    # equal odds on both sides put the edge where the pixels meet
    return edge + step * (inner / (inner - values[beyond]) - 0.5)


@fast_part
def _edges(mask, odds, columns, rows):
    """Left, top, right and bottom of a mask: where the largest of the odds per row or column crosses zero."""
    h, w = mask.shape
    left, right, top, bottom = extremes(mask, odds, columns, rows)
    if right < 0:
        return 0.0, 0.0, 0.0, 0.0
    back, on = np.int64(-1), np.int64(1)
    return (
        _crossing(columns, w, left, back),
        _crossing(rows, h, top, back),
        _crossing(columns, w, right, on),
        _crossing(rows, h, bottom, on),
    )


@fast_kernel
def label(
    image: Image,
    background: Image,
    counts: Image,
    warped: Plane,
    own: Mask,
    shape: Plane,
    evidence: Image,
    fresh: Mask,
    before: Mask,
    hiding: Mask,
    emerging: bool,
    colours: Plane,
    weight: float,
    noise: float,
    growth: int,
    young: bool,
    least: float,
    inside: Integers,
    spare: Masks,
    runs: Runs,
    lines: Plane,
    bins: Bins,
    raw: Plane,
    odds: Plane,
    mask: Mask,
    foreign: Mask,
) -> tuple[int, int, int, int, float, float, float, float]:
    """Mask of the object from the evidence, and what is visible of it.

    Parameters
    ----------
    image, background, counts
        This frame, and the background with its counts.
    warped, own, shape
        The object's log-odds, {log-odds > 0} and slow shape where they are expected.
    evidence, fresh
        What :func:`evidence` wrote. The ratio, its first plane, is changed where something is new.
    before, hiding
        Masks of the last frame's distractor, and of where it hides the object; of 0 × 0 pixels if there is none.
    emerging
        The object may be coming out from behind something.
    colours, weight
        Histograms of object and background, and how much they count.
    noise
        Gray levels.
    growth, young, least
        Px by which the object may grow (0: what is new says nothing), and whether its motion is too little known for
        that; share of the mask that must be left when its edge is cut.
    inside
        Part of the window inside the frame.
    spare, runs, lines
        Workspaces: (5, h, w), (as many runs as there can be, 6) and (3, as many as bins, columns or rows).
    bins, raw, odds, mask, foreign
        Receive the bin of each colour, the log-odds as they come out of evidence and colour, the log-odds with all
        that is known of shape, the mask, and the distractor.

    Returns
    -------
    Pixels of the distractor; inside the frame pixels of the shape, of these in the mask, and of the mask; left, top,
    right and bottom of the mask, all 0 if it is empty.
    """
    h, w, channels = image.shape
    if channels != 3 or background.shape[2] != 3:
        return 0, 0, 0, 0, 0.0, 0.0, 0.0, 0.0
    kinds = spare[0]
    area = np.int64(0)  # of one type from the start, as what is compiled for it is
    for y in range(h):
        for x in range(w):
            area += own[y, x]
            kinds[y, x] = 0
            foreign[y, x] = 0
    if growth > 0:
        _arrivals(fresh, own, before, area, emerging, growth, young, spare, runs, kinds, foreign)
    if hiding.shape[0] > 0:
        for y in range(h):
            for x in range(w):
                kinds[y, x] = _HIDING if hiding[y, x] != 0 else kinds[y, x]
                foreign[y, x] |= hiding[y, x]
    ratio = lines[0]
    # histograms that overlap tell next to nothing
    trust = weight * larger(0.0, 1.1 - likelihood(colours, ratio))
    _log_odds(image, warped, evidence, kinds, ratio, trust, bins, raw)
    for y in range(h):
        for x in range(w):
            mask[y, x] = 1 if raw[y, x] > f32(0.0) else 0
    _open(mask, area, spare)
    _own_component(mask, own, area, runs)
    others = _settle(raw, mask, foreign, warped, odds)
    if not _cut_edge(image, background, counts, noise, least, spare, mask, odds):
        _settle(raw, mask, foreign, warped, odds)
    expected, both, seen = overlap(mask, shape, inside)
    left, top, right, bottom = _edges(mask, odds, lines[1], lines[2])
    return others, expected, both, seen, left, top, right, bottom
