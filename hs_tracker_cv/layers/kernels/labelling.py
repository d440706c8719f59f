"""Which pixels are the object, and what is learned from that."""

# Parts have no types of their own: Numba infers them.
# mypy: allow-untyped-defs, no-check-untyped-defs, allow-untyped-calls
from __future__ import annotations

import numpy as np

from ...compiling import larger, local, root, smaller
from .common import KNOWN, Bins, Image, Integers, Mask, Numbers, Plane, Row, fast_kernel, select

_three = local(3)


@fast_kernel
def local_products(image: Image, background: Image, obj: Image, out: Image) -> None:
    """Channel sums of I·B, B·B, I·O, O·O into out (h, w, 4): box-filtered, they give the local gains."""
    h, w, channels = image.shape
    for y in range(h):
        for x in range(w):
            ib = bb = io = oo = 0.0
            for c in range(channels):
                i = image[y, x, c]
                b = background[y, x, c]
                o = obj[y, x, c]
                ib += i * b
                bb += b * b
                io += i * o
                oo += o * o
            out[y, x, 0] = ib
            out[y, x, 1] = bb
            out[y, x, 2] = io
            out[y, x, 3] = oo


@fast_kernel
def evidence(
    image: Image,
    background: Image,
    moved: Image,
    carried: Image,
    obj: Image,
    warped: Plane,
    counts: Image,
    products: Image,
    noise: np.float32,
    knobs: Row,
    inside: Integers,
    out: Image,
    fresh: Mask,
) -> float:
    """Log-likelihood ratio, object against background, per pixel.

    Parameters are windows: current image, background layer, previous image moved by the camera and by the object's
    motion, object layer and log-odds warped by the object's motion, the background's counts, filtered products.
    knobs = (tau_b², tau_o², κ, motion contrast, occluded).
    out[0] log-likelihood ratio, out[1] error against the background (any explanation), out[2] the same without
    gain or previous image, out[3] local gain of the background, out[4] error against the previous image where
    the background is not yet known. `fresh` is 1 where something new covers a background that was seen a moment ago.
    Returns the share of the object's pixels that look about as they did.
    """
    h, w, channels = image.shape
    tau_b = knobs[0]
    tau_o = knobs[1]
    kappa = knobs[2]
    contrast = knobs[3]
    occluded = knobs[4]
    mean = 1.0 / channels
    noise2 = noise * noise
    like = (6.0 * noise + 6.0) * (6.0 * noise + 6.0) * channels
    own = 0
    alike = 0.0
    for y in range(h):
        ym = larger(y - 1, 0)
        yp = smaller(y + 1, h - 1)
        for x in range(w):
            fresh[y, x] = 0
            if x < inside[0] or y < inside[1] or x >= inside[2] or y >= inside[3]:
                out[0, y, x] = -2.0
                out[1, y, x] = 0.0
                out[2, y, x] = 0.0
                out[3, y, x] = 1.0
                out[4, y, x] = 0.0
                continue
            xm = larger(x - 1, 0)
            xp = smaller(x + 1, w - 1)
            n = counts[0, y, x]
            s = warped[y, x]
            gain_b = (products[y, x, 0] + 50.0) / (products[y, x, 1] + 50.0)
            gain_b = smaller(larger(gain_b, 0.35), 2.5)
            grad_b = b2 = eb = egb = 0.0
            for c in range(channels):
                i = image[y, x, c]
                b = background[y, x, c]
                gx = background[y, xp, c] - background[y, xm, c]
                gy = background[yp, x, c] - background[ym, x, c]
                grad_b += gx * gx + gy * gy
                b2 += b * b
                e = i - b
                eb += e * e
                e = i - gain_b * b
                egb += e * e
            # the factor ¼ makes (difference over two pixels)² the gradient squared; κ/s² of the channel mean
            grad_b *= mean / 4.0
            var_b = noise2 * (1.0 + 1.0 / larger(n, 1.0)) + tau_b * grad_b
            unit = kappa * mean / var_b
            direct = eb * unit
            out[2, y, x] = direct
            out[3, y, x] = gain_b
            out[4, y, x] = 0.0
            if s < -2.5 and n >= KNOWN and direct < 2.0:  # far from the object and as ever: nothing more to weigh
                out[0, y, x] = 0.5 * (direct - 5.0)
                out[1, y, x] = direct
                continue
            gain_o = (products[y, x, 2] + 50.0) / (products[y, x, 3] + 50.0)
            gain_o = smaller(larger(gain_o, 0.6), 1.7)
            grad_o = em = eo = ego = ec = 0.0
            for c in range(channels):
                i = image[y, x, c]
                o = obj[y, x, c]
                gx = obj[y, xp, c] - obj[y, xm, c]
                gy = obj[yp, x, c] - obj[ym, x, c]
                grad_o += gx * gx + gy * gy
                e = i - moved[y, x, c]
                em += e * e
                e = i - carried[y, x, c]
                ec += e * e
                e = i - o
                eo += e * e
                e = i - gain_o * o
                ego += e * e
            if s > 0.0:
                own += 1
                if eo < like or ego < 0.25 * like:
                    alike += 1.0
            var_o = 1.5 * noise2 + tau_o * grad_o * mean / 4.0
            error_b = direct
            if gain_b < 0.97:
                # a shadow leaves the texture: where there is some, to be explained that way is no accident, unless
                # there is so much noise that a dark object would do as well
                error_b = smaller(error_b, egb * unit + larger(2.0, 0.8 * noise) / (1.0 + grad_b / noise2))
            elif gain_b > 1.03:
                lifted = kappa * mean / (var_b + 0.0025 * b2 * mean)
                error_b = smaller(error_b, egb * lifted + 3.0)
            if n < KNOWN:
                still = em * kappa * mean / (2.0 * noise2 + tau_b * grad_b)
                out[4, y, x] = still
                error_b = smaller(error_b, still)
            error_o = smaller(eo, ego + var_o / (kappa * mean)) * kappa * mean / var_o
            if n < KNOWN:
                # the background may be explained by the last frame here, so the object may be too: a plain area
                # looks as it looked a moment ago with either motion
                error_o = smaller(error_o, ec * kappa * mean / (2.0 * noise2 + tau_o * grad_o * mean / 4.0))
            if s < -0.5:
                error_o = 5.0  # its appearance there is unknown
            ceiling = 9.0 if n >= KNOWN else 4.0
            ll = 0.5 * (smaller(error_b, ceiling) - smaller(error_o, 5.0))
            if n >= KNOWN and error_b < 4.0:
                ll -= 0.8 * contrast * (1.0 - error_b / 4.0)
            if contrast < 0.99 and ll < 0.0 and n < 7.0 and s > 0.0:
                ll *= contrast
            if occluded > 0.0 and n > KNOWN and error_b < 2.0:
                ll = smaller(ll, -1.5)
            if error_b >= 7.2 and n > KNOWN and counts[2, y, x] <= 4.0:
                fresh[y, x] = 1
            out[0, y, x] = ll
            out[1, y, x] = error_b
    if own:
        alike /= own
    return alike


@fast_kernel
def label(
    image: Image, warped: Plane, ll: Plane, grown: Mask, ratio: Row, trust: float, bins: Bins, out: Plane
) -> None:
    """Log-odds of object after this frame's evidence: 0.9 warped + 0.7 ll + trust · colour ratio.

    `grown` is 1 where the object has grown, 2 on a distractor, 3 where that covers the object; `ll` is changed there.
    `ratio` is the log-ratio of the colour histograms per bin, clipped; `bins` receives each pixel's bin.
    """
    h, w, channels = image.shape
    for y in range(h):
        for x in range(w):
            if channels == 3:
                blue = np.int64(image[y, x, 0])
                green = np.int64(image[y, x, 1])
                red = np.int64(image[y, x, 2])
                b = ((blue >> 5) << 6) + ((green >> 5) << 3) + (red >> 5)
            else:
                b = np.int64(image[y, x, 0]) >> 3
            bins[y, x] = b
            s = warped[y, x]
            if grown[y, x] == 1:
                ll[y, x] = larger(ll[y, x], 2.0)
                s = larger(s, -0.5)
            elif grown[y, x] == 3:
                ll[y, x] = smaller(ll[y, x], -2.0)
                s = smaller(s, -1.0)
            elif grown[y, x] == 2 and s < 1.0:
                ll[y, x] = smaller(ll[y, x], -1.0)
            p = 0.9 * s + 0.7 * ll[y, x] + trust * ratio[b]
            out[y, x] = smaller(larger(p, -5.0), 5.0)


@fast_kernel
def alpha_edge(
    image: Image, background: Image, seen: Plane, core: Mask, wide: Mask, mask: Mask, noise: float, odds: Plane
) -> None:
    """Mixed pixels of the mask's edge: α of I = α o + (1 − α) b, and the odds lowered where α says background.

    o is the mean of the `core` pixels within 3 px, b the background, or, where that was never seen, the mean of the
    pixels outside `wide` within 3 px.
    """
    h, w, channels = image.shape
    inner = _three()
    outer = _three()
    for y in range(h):
        for x in range(w):
            if mask[y, x] == 0 or core[y, x] != 0:
                continue
            own = seen[y, x] >= KNOWN
            n_in = n_out = 0
            for c in range(channels):
                inner[c] = 0.0
                outer[c] = 0.0
            for j in range(larger(y - 3, 0), smaller(y + 4, h)):
                for i in range(larger(x - 3, 0), smaller(x + 4, w)):
                    if core[j, i] != 0:
                        n_in += 1
                        for c in range(channels):
                            inner[c] += image[j, i, c]
                    elif not own and wide[j, i] == 0:
                        n_out += 1
                        for c in range(channels):
                            outer[c] += image[j, i, c]
            if n_in == 0 or (not own and n_out == 0):
                continue
            span = along = total = 0.0
            for c in range(channels):
                b = background[y, x, c] if own else outer[c] / n_out
                d = inner[c] / n_in - b
                e = image[y, x, c] - b
                span += d * d
                along += d * e
                total += e * e
            if span * (3.0 / channels) <= 36.0 * noise * noise + 100.0:
                continue
            alpha = along / span
            if alpha < 0.7 and total - alpha * along < 0.15 * span:
                odds[y, x] = smaller(odds[y, x], larger(8.0 * (alpha - 0.5), -3.0))


@fast_kernel
def learn(
    image: Image,
    aligned: Image,
    mask: Mask,
    near: Mask,
    odds: Plane,
    raw: Plane,
    warped: Plane,
    obj: Image,
    shape: Plane,
    errors: Image,
    bins: Bins,
    inside: Integers,
    knobs: Row,
    s_out: Plane,
    o_out: Image,
    m_out: Plane,
    ground: Image,
    counts: Image,
    tally: Plane,
    sample: Plane,
    sums: Numbers,
) -> None:
    """What is remembered after a frame: log-odds, object layer, slow shape, background, colours.

    `aligned` is the image on the background's own lattice. `near` is 1 within two pixels of the object, 2 on a
    distractor elsewhere. `errors` is what :func:`evidence` wrote. `ground` (h, w, C) and `counts` (3, h, w: samples,
    mismatches, age) are the background, updated in place. knobs = (shape rate, freeze, occluded). `tally` (2, bins)
    receives the colour counts of object and background. `sums` receives (known pixels outside, of these unexplained,
    85th percentile of |I − B| there); `sample` is a workspace for that.
    """
    h, w, channels = image.shape
    shape_rate = knobs[0]
    freeze = knobs[1]
    occluded = knobs[2]
    mean = 1.0 / channels
    known = 0
    strange = 0
    taken = 0
    for y in range(h):
        for x in range(w):
            m = mask[y, x] != 0
            s = warped[y, x]
            belief = odds[y, x]
            if m:
                s_new = larger(raw[y, x], 0.2)
            else:
                s_new = s + 0.5 * (belief - s)
            s_out[y, x] = smaller(larger(s_new, -3.0), 4.0)
            m_out[y, x] = shape[y, x]
            if freeze == 0.0:
                target = smaller(larger(belief + 0.5, 0.0), 1.0) if m else 0.0
                m_out[y, x] += shape_rate * (target - shape[y, x])
            rate = 0.0
            if m:
                if errors[0, y, x] > -0.3 and (occluded == 0.0 or errors[1, y, x] >= 4.0):
                    d = 0.0
                    for c in range(channels):
                        d += image[y, x, c] - obj[y, x, c]
                    # what has lit up that much is rather a highlight that moves on than the surface
                    rate = 0.5 if d * mean < 25.0 else 0.1
            elif freeze == 0.0:
                rate = 1.0
            for c in range(channels):
                o = obj[y, x, c]
                o_out[y, x, c] = o + rate * (image[y, x, c] - o)
            if x < inside[0] or y < inside[1] or x >= inside[2] or y >= inside[3]:
                continue
            n = counts[0, y, x]
            free = near[y, x] != 1
            if free:
                tally[1, bins[y, x]] += 1.0
            elif m and belief > 1.0:
                tally[0, bins[y, x]] += 1.0
            error = errors[1, y, x]
            gain = errors[3, y, x]
            if free and n >= KNOWN:
                known += 1
                if error > 5.0:
                    strange += 1
                if near[y, x] == 0 and (x + 2 * y) % 7 == 0 and taken < sample.shape[1]:
                    # in shadow, by what the shadow leaves unexplained
                    light = gain if gain < 0.9 or gain > 1.1 else 1.0
                    d = 0.0
                    for c in range(channels):
                        d += abs(aligned[y, x, c] - light * ground[y, x, c])
                    sample[0, taken] = d * mean
                    taken += 1
            if not m and error < 4.0 and n >= KNOWN:
                counts[2, y, x] = 0.0
            else:
                counts[2, y, x] += 1.0
            if not free or belief >= -1.0:
                continue
            if n < KNOWN and errors[4, y, x] >= 4.0:
                n = 0.0  # something moves here: begin again
            if n >= KNOWN and error >= 6.0:
                bad = counts[1, y, x] + 1.0
                counts[1, y, x] = bad
                if bad < 6.0 or (bad < 25.0 and (gain < 0.93 or gain > 1.07)):
                    continue
                n = 0.0
            else:
                counts[1, y, x] = 0.0
            if n >= KNOWN and gain <= 0.93:
                continue
            if n >= KNOWN and gain > 1.07:
                n = 0.0
            rate = larger(1.0 / (n + 1.0), 0.06)
            if n >= KNOWN and gain < 0.985:
                rate = smaller(rate, 0.02)
            for c in range(channels):
                b = ground[y, x, c]
                ground[y, x, c] = b + rate * (aligned[y, x, c] - b)
            counts[0, y, x] = smaller(n + 1.0, 20.0)
    sums[0] = known
    sums[1] = strange
    sums[2] = select(sample[0], taken, 0.85) if taken > 10 else -1.0
