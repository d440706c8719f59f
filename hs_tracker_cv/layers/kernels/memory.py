"""What is learned from a labelled frame."""

# Parts have no types of their own: Numba infers them.
# mypy: allow-untyped-defs, no-check-untyped-defs, allow-untyped-calls
from __future__ import annotations

import numpy as np

from ...compiling import larger, local, smaller
from .colour import blend
from .common import KNOWN, Bins, Image, Integers, Mask, Masks, Plane, Row, fast_kernel, fast_part, select
from .shapes import widen

f32 = np.float32
_BLOCK = 64  # pixels at a time: results first go to short arrays on the stack, which overlap with nothing

_block = local(_BLOCK)


@fast_part
def _surround(mask, own, foreign, spare, near):
    """Write 1 within two pixels of the object, where it is or was expected, and 2 on a distractor elsewhere.

    A second mover is neither ground to be learned nor noise.
    """
    h, w = mask.shape
    either = spare[1]
    for y in range(h):
        for x in range(w):
            either[y, x] = mask[y, x] | own[y, x]
    widen(either, 2, spare[2], near)
    if foreign.shape[0] > 0:
        for y in range(h):
            for x in range(w):
                near[y, x] |= (foreign[y, x] & (near[y, x] ^ 1)) << 1


@fast_part
def _count_colours(mask, near, odds, bins, inside, tally):
    """Count the colours of object and background, of every second pixel."""
    for which in range(2):
        for i in range(tally.shape[1]):
            tally[which, i] = f32(0.0)
    for y in range(inside[1], inside[3]):
        for x in range(inside[0] + (inside[0] + y) % 2, inside[2], 2):
            if near[y, x] != 1:
                tally[1, np.int64(bins[y, x])] += f32(1.0)
            elif mask[y, x] != 0 and odds[y, x] > f32(1.0):
                tally[0, np.int64(bins[y, x])] += f32(1.0)


@fast_kernel
def learn(
    image: Image,
    aligned: Image,
    mask: Mask,
    own: Mask,
    foreign: Mask,
    odds: Plane,
    raw: Plane,
    warped: Plane,
    obj: Image,
    shape: Plane,
    errors: Image,
    bins: Bins,
    ground: Image,
    counts: Image,
    part: Integers,
    inside: Integers,
    shape_rate: np.float32,
    freeze: bool,
    hidden: bool,
    colours: Plane,
    colour_rate: float,
    spare: Masks,
    tally: Plane,
    sample: Row,
    s_out: Plane,
    o_out: Image,
    m_out: Plane,
    ground_out: Image,
    counts_out: Image,
    colours_out: Plane,
) -> tuple[int, int, float]:
    """What is remembered after a frame: log-odds, object layer, slow shape, background, colours.

    Parameters
    ----------
    image, aligned
        This frame, and the same on the background's own lattice.
    mask, own, foreign
        The object's mask, the same as it was expected, and the distractor's (0 × 0 pixels if there is none).
    odds, raw, bins
        What :func:`label` wrote.
    warped, obj, shape, part
        Log-odds, image and slow shape of the object as they were expected; where the object layer has been warped.
    errors
        What :func:`evidence` wrote.
    ground, counts
        The background: image, and (3, h, w) samples, mismatches and age.
    inside
        Part of the window inside the frame.
    shape_rate, freeze, hidden
        How fast the shape is learned, or not at all; whether something is in front of the object.
    colours, colour_rate
        Histograms of object and background, and how fast they are learned.
    spare, tally, sample
        Workspaces: (3, h, w), as large as the histograms, and for as many background pixels as are looked at.
    s_out, o_out, m_out, ground_out, counts_out, colours_out
        Receive log-odds, object layer, shape, background and histograms.

    Returns
    -------
    Known pixels outside, of these unexplained, and the 85th percentile of |I − B| there, −1 if they are too few.
    """
    h, w, channels = image.shape
    if (
        channels != 3
        or aligned.shape[2] != 3
        or obj.shape[2] != 3
        or ground.shape[2] != 3
        or o_out.shape[2] != 3
        or ground_out.shape[2] != 3
    ):
        return 0, 0, -1.0  # from here on LLVM knows it, and can vectorise
    near = spare[0]
    _surround(mask, own, foreign, spare, near)
    odds_new = _block()
    shape_new = _block()
    rate_o = _block()
    rate_b = _block()
    samples = _block()
    mismatches = _block()
    age = _block()
    known = 0
    strange = 0
    taken = 0
    for y in range(h):
        seen = y >= inside[1] and y < inside[3]
        warped_row = y >= part[1] and y < part[3]
        for first in range(0, w, _BLOCK):
            m = smaller(w - first, _BLOCK)
            for i in range(m):
                x = first + i
                own = mask[y, x] != 0
                s = warped[y, x]
                belief = odds[y, x]
                new = larger(raw[y, x], f32(0.2)) if own else s + f32(0.5) * (belief - s)
                odds_new[i] = smaller(larger(new, f32(-3.0)), f32(4.0))
                old = shape[y, x]
                target = smaller(larger(belief + f32(0.5), f32(0.0)), f32(1.0)) if own else f32(0.0)
                shape_new[i] = old + (shape_rate * (target - old) if not freeze else f32(0.0))
                d = image[y, x, 0] - obj[y, x, 0] + image[y, x, 1] - obj[y, x, 1] + image[y, x, 2] - obj[y, x, 2]
                # what has lit up that much is rather a highlight that moves on than the surface
                rate = f32(0.5) if d < f32(75.0) else f32(0.1)
                sure = (errors[0, y, x] > f32(-0.3)) & ((not hidden) | (errors[1, y, x] >= f32(4.0)))
                free = f32(1.0) if not freeze else f32(0.0)
                rate_o[i] = (rate if sure else f32(0.0)) if own else free
                covered = warped_row & (x >= part[0]) & (x < part[2])
                rate_o[i] = rate_o[i] if covered else 1.0
            for i in range(m):
                x = first + i
                s_out[y, x] = odds_new[i]
                m_out[y, x] = shape_new[i]
            for i in range(m):
                x = first + i
                rate = f32(rate_o[i])
                o_out[y, x, 0] = obj[y, x, 0] + rate * (image[y, x, 0] - obj[y, x, 0])
                o_out[y, x, 1] = obj[y, x, 1] + rate * (image[y, x, 1] - obj[y, x, 1])
                o_out[y, x, 2] = obj[y, x, 2] + rate * (image[y, x, 2] - obj[y, x, 2])
            for i in range(m):
                x = first + i
                n = counts[0, y, x]
                bad = counts[1, y, x]
                error = errors[1, y, x]
                gain = errors[2, y, x]
                here = seen & (x >= inside[0]) & (x < inside[2])
                free = near[y, x] != 1
                learned = here & free & (odds[y, x] < f32(-1.0))
                matched = (mask[y, x] == 0) & (error < f32(4.0)) & (n >= KNOWN)
                ticks = f32(0.0) if matched else counts[2, y, x] + f32(1.0)
                age[i] = ticks if here else counts[2, y, x]
                counted = here & free & (n >= KNOWN)
                known += 1 if counted else 0
                strange += 1 if counted & (error > f32(5.0)) else 0
                # something moves here: begin again
                base = f32(0.0) if (n < KNOWN) & (errors[3, y, x] >= f32(4.0)) else n
                odd = (base >= KNOWN) & (error >= f32(6.0))
                worse = bad + f32(1.0) if odd else f32(0.0)
                mismatches[i] = worse if learned else bad
                shaded = (gain < f32(0.93)) | (gain > f32(1.07))
                wait = odd & ((worse < f32(6.0)) | ((worse < f32(25.0)) & shaded))
                base = f32(0.0) if odd else base
                dark = (base >= KNOWN) & (gain <= f32(0.93))
                base = f32(0.0) if (base >= KNOWN) & (gain > f32(1.07)) else base
                rate = larger(f32(1.0) / (base + f32(1.0)), f32(0.06))
                rate = smaller(rate, f32(0.02)) if (base >= KNOWN) & (gain < f32(0.985)) else rate
                learned = learned & (not wait) & (not dark)
                rate_b[i] = rate if learned else f32(0.0)
                samples[i] = smaller(base + f32(1.0), f32(20.0)) if learned else n
            for i in range(m):
                counts_out[0, y, first + i] = samples[i]
                counts_out[1, y, first + i] = mismatches[i]
                counts_out[2, y, first + i] = age[i]
            for i in range(m):
                x = first + i
                rate = f32(rate_b[i])
                ground_out[y, x, 0] = ground[y, x, 0] + rate * (aligned[y, x, 0] - ground[y, x, 0])
                ground_out[y, x, 1] = ground[y, x, 1] + rate * (aligned[y, x, 1] - ground[y, x, 1])
                ground_out[y, x, 2] = ground[y, x, 2] + rate * (aligned[y, x, 2] - ground[y, x, 2])
        if not seen:
            continue
        for x in range(inside[0] + (7 - (inside[0] + 2 * y) % 7) % 7, inside[2], 7):
            if near[y, x] == 0 and counts[0, y, x] >= KNOWN and taken < sample.shape[0]:
                # in shadow, by what the shadow leaves unexplained
                gain = errors[2, y, x]
                light = gain if gain < f32(0.9) or gain > f32(1.1) else f32(1.0)
                d = abs(aligned[y, x, 0] - light * ground[y, x, 0])
                d += abs(aligned[y, x, 1] - light * ground[y, x, 1])
                d += abs(aligned[y, x, 2] - light * ground[y, x, 2])
                sample[taken] = d
                taken += 1
    _count_colours(mask, near, odds, bins, inside, tally)
    blend(colours, tally, colour_rate, colours_out)
    spread = select(sample, taken, 0.85) / 3.0 if taken > 10 else -1.0
    return known, strange, spread
