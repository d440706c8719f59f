"""The kernels of labelling and learning, against OpenCV, NumPy and frames whose truth is constructed here."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from hs_tracker_cv._native.kernels import segmentation as kernels
from hs_tracker_cv.segmentation import colour
from tests.conftest import LIKELIHOOD

Mask = NDArray[np.uint8]
H, W = 48, 64


def random_masks() -> Iterator[Mask]:
    """Masks of several sizes and densities, with specks, blobs and a full border."""
    rng = np.random.default_rng(0)
    for h, w in ((24, 24), (30, 37), (41, 28)):
        yield np.zeros((h, w), np.uint8)
        yield np.ones((h, w), np.uint8)
        for density in (0.02, 0.2, 0.5, 0.8, 0.98):
            yield (rng.uniform(size=(h, w)) < density).astype(np.uint8)
            blobs = cv2.GaussianBlur(rng.uniform(size=(h, w)), (0, 0), 2.0)
            yield (blobs > np.quantile(blobs, density)).astype(np.uint8)


@pytest.mark.parametrize("reach", [0, 1, 2, 4])
def test_widening_is_dilation_by_a_square(reach: int) -> None:
    """Whatever lies beyond the border is ignored."""
    for mask in random_masks():
        out = np.empty_like(mask)
        kernels.widen(mask, reach, out)
        wanted = cv2.dilate(mask, np.ones((2 * reach + 1, 2 * reach + 1), np.uint8))
        np.testing.assert_array_equal(out, wanted)


def test_widening_by_a_cross_is_dilation_by_a_cross() -> None:
    """Four neighbours and the pixel itself."""
    for mask in random_masks():
        out = np.empty_like(mask)
        kernels.widen_cross(mask, out)
        np.testing.assert_array_equal(out, cv2.dilate(mask, cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))))


@pytest.mark.parametrize("reach", [1, 2])
def test_widening_what_is_outside_is_erosion(reach: int) -> None:
    """The border does not erode; the pixels left are counted."""
    for mask in random_masks():
        outside, wide, out = np.empty_like(mask), np.empty_like(mask), np.empty_like(mask)
        kernels.invert(mask, outside)
        kernels.widen(outside, reach, wide)
        assert kernels.invert(wide, out) == np.count_nonzero(out)
        np.testing.assert_array_equal(out, cv2.erode(mask, np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)))


def test_median_is_that_of_three_by_three_pixels() -> None:
    """The border is repeated."""
    for mask in random_masks():
        out = np.empty_like(mask)
        kernels.median(mask, out)
        np.testing.assert_array_equal(out, cv2.medianBlur(mask, 3))


def test_without_is_a_difference() -> None:
    """What is left is counted."""
    masks = [mask for mask in random_masks() if mask.shape == (30, 37)]
    for mask in masks:
        for other in masks:
            out = np.empty_like(mask)
            assert kernels.without(mask, other, out) == np.count_nonzero(out)
            np.testing.assert_array_equal(out, (mask == 1) & (other == 0))


def test_spreading_is_dilation_within_bounds() -> None:
    """Growth by some steps is as many dilations, each cut to what is allowed or there already."""
    rng = np.random.default_rng(4)
    allowed = (rng.uniform(size=(30, 37)) < 0.6).astype(np.uint8)
    seed = (rng.uniform(size=(30, 37)) < 0.02).astype(np.uint8)
    grown, wanted = seed.copy(), seed.copy()
    kernels.spread(allowed, 4, grown)
    for _ in range(4):
        wanted = np.asarray(cv2.dilate(wanted, np.ones((3, 3), np.uint8))) & (allowed | seed)
    np.testing.assert_array_equal(grown, wanted)
    assert np.count_nonzero(grown) > np.count_nonzero(seed)


def test_components_are_those_of_eight_neighbours() -> None:
    """The same parts as OpenCV's, each with its area and with what it has in common with another mask."""
    rng = np.random.default_rng(5)
    for mask in random_masks():
        h, w = mask.shape
        other = (rng.uniform(size=(h, w)) < 0.3).astype(np.uint8)
        runs = np.empty((h * ((w + 1) // 2), 6), np.int32)
        n, found = kernels.components(mask, other, runs)
        count, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
        assert found == count - 1
        drawn, heads = np.zeros_like(mask), {}
        for row, first, end, head, _, _ in runs[:n].tolist():
            drawn[row, first:end] = 1
            (label,) = set(labels[row, first:end].tolist())
            assert heads.setdefault(head, label) == label
        np.testing.assert_array_equal(drawn, mask)
        assert len(set(heads.values())) == found
        for head, label in heads.items():
            area, common = runs[head, 4:].tolist()
            assert area == stats[label, cv2.CC_STAT_AREA]
            assert common == np.count_nonzero(other[labels == label])


def test_a_comb_is_one_component() -> None:
    """Teeth that meet only in the last row, and a spiral, are joined at last."""
    comb = np.zeros((24, 31), np.uint8)
    comb[:, ::2] = 1
    comb[-1] = 1
    spiral = np.zeros((25, 25), np.uint8)
    y, x, length = 0, 0, 24
    for turn, (dy, dx) in enumerate([(0, 1), (1, 0), (0, -1), (-1, 0)] * 5):
        for _ in range(length):
            spiral[y, x] = 1
            y, x = y + dy, x + dx
        length -= 2 * (turn % 2 and turn > 0)
        if length <= 0:
            break
    for mask in (comb, spiral):
        runs = np.empty((mask.shape[0] * ((mask.shape[1] + 1) // 2), 6), np.int32)
        n, found = kernels.components(mask, mask, runs)
        assert n > 20
        assert found == 1


class Labelled(NamedTuple):
    """What `kernels.label` gave: its answer, and the planes it wrote."""

    answer: tuple[Any, ...]
    mask: Mask
    odds: NDArray[np.float32]
    raw: NDArray[np.float32]
    foreign: Mask
    bins: NDArray[np.int16]


def labelled(expected: Mask, evidence: NDArray[np.float32], **changes: Any) -> Labelled:
    """Label a frame in which the object was expected in a mask; gray, of one colour, unless said otherwise."""
    given: dict[str, Any] = {
        "image": np.full((H, W, 3), 100.0, np.float32),
        "background": np.full((H, W, 3), 100.0, np.float32),
        "counts": np.full((3, H, W), 9.0, np.float32),
        "warped": np.where(expected != 0, 1.0, -3.0).astype(np.float32),
        "fresh": np.zeros((H, W), np.uint8),
        "before": None,
        "hiding": None,
        "emerging": False,
        "colours": np.full((2, colour.BINS), 1 / colour.BINS, np.float32),
        "weight": 0.0,
        "growth": 4,
        "young": False,
        "left": 0.6,
        **changes,
    }
    mask, foreign = np.empty((H, W), np.uint8), np.empty((H, W), np.uint8)
    raw, odds, bins = np.empty((H, W), np.float32), np.empty((H, W), np.float32), np.empty((H, W), np.int16)
    image, whole = given["image"], np.array((0, 0, W, H))
    how = kernels.Labelling(
        colours=given["colours"],
        colour_weight=given["weight"],
        noise=2.0,
        least=given["left"],
        growth=given["growth"],
        emerging=given["emerging"],
        young=given["young"],
    )
    *pixels, edges = kernels.label(
        kernels.Scene(image, whole, image, given["background"], given["counts"]),
        kernels.Expected(image, image, given["warped"], (expected != 0).astype(np.float32), expected, whole),
        kernels.Evidence(np.stack([evidence] * 4), given["fresh"]),
        given["before"],
        given["hiding"],
        how,
        kernels.Labels(bins, raw, odds, mask, foreign),
    )
    return Labelled((*pixels, *edges), mask, odds, raw, foreign, bins)


def rectangle(x0: int, y0: int, x1: int, y1: int) -> Mask:
    """A mask."""
    mask = np.zeros((H, W), np.uint8)
    mask[y0:y1, x0:x1] = 1
    return mask


OBJECT = rectangle(16, 10, 46, 40)  # large enough to be opened by squares, which leave its corners
SURE = np.where(OBJECT != 0, 2.0, -2.0).astype(np.float32)


def test_what_is_expected_and_seen_is_the_object() -> None:
    """The mask is the object; all of its shape is visible; its box ends where equal odds meet."""
    found = labelled(OBJECT, SURE, warped=np.where(OBJECT != 0, 2.0, -2.0).astype(np.float32))
    np.testing.assert_array_equal(found.mask, OBJECT)
    assert found.answer[:4] == (0, 900, 900, 900)
    assert found.answer[4:] == pytest.approx((16, 10, 46, 40), abs=1e-5)
    assert not found.foreign.any()
    np.testing.assert_allclose(found.odds, np.where(OBJECT != 0, 3.2, -3.2), atol=1e-6)


def test_the_box_ends_where_the_odds_cross_zero() -> None:
    """Odds of 3 beside −1 put it three quarters on the way from pixel to pixel; the window's border is an edge."""
    warped = np.full((H, W), -1.0, np.float32)
    warped[10:30, 5:W] = 3.0
    own = (warped > 0).astype(np.uint8)
    found = labelled(own, warped, warped=warped)
    left, top, right, bottom = found.answer[4:]
    assert (left, top, right, bottom) == pytest.approx((4.75, 9.75, W, 30.25), abs=1e-5)


def test_an_empty_mask_has_no_box() -> None:
    """All edges are zero."""
    found = labelled(np.zeros((H, W), np.uint8), np.full((H, W), -2.0, np.float32))
    assert not found.mask.any()
    assert found.answer == (0, 0, 0, 0, 0.0, 0.0, 0.0, 0.0)


def test_what_is_new_beside_the_object_belongs_to_it() -> None:
    """Within reach it is object; not while the motion is little known, and not where nothing may grow."""
    fresh = rectangle(46, 14, 49, 30)
    parts = {"fresh": OBJECT | fresh}
    assert labelled(OBJECT, SURE, **parts).mask[20, 47] == 1
    assert labelled(OBJECT, SURE, young=True, **parts).mask[20, 47] == 0
    assert labelled(OBJECT, SURE, growth=0, **parts).mask[20, 47] == 0
    assert labelled(OBJECT, SURE, growth=2, **parts).mask[20, 47:49].tolist() == [1, 0]


def test_what_is_new_elsewhere_is_something_else() -> None:
    """Far from the object it is a distractor, and lowers the odds; specks are not, nor what comes out of hiding."""
    far, speck = rectangle(53, 2, 61, 10), rectangle(4, 40, 6, 42)
    seen = np.where((OBJECT | far) != 0, 2.0, -2.0).astype(np.float32)
    warped = np.where((OBJECT | far) != 0, 0.5, -3.0).astype(np.float32)
    found = labelled(OBJECT, seen, fresh=far | speck, warped=warped)
    median = cv2.medianBlur(far, 3)
    np.testing.assert_array_equal(found.foreign, median)
    assert found.answer[0] == np.count_nonzero(median)
    assert found.odds[median != 0].max() <= -2.0
    np.testing.assert_array_equal(found.mask, OBJECT)
    emerging = labelled(OBJECT, seen, fresh=far | speck, warped=warped, emerging=True)
    assert not emerging.foreign.any()
    assert emerging.answer[0] == 0


def test_a_distractor_stays_one_when_it_comes_near() -> None:
    """What is new beside the distractor of the last frame is the distractor, not the object grown."""
    near = rectangle(46, 14, 49, 30)
    found = labelled(OBJECT, SURE, fresh=near, before=rectangle(49, 14, 58, 30))
    np.testing.assert_array_equal(found.foreign, cv2.medianBlur(near, 3))
    np.testing.assert_array_equal(found.mask, OBJECT)


def test_where_the_object_is_hidden_it_is_not_seen() -> None:
    """A mover in front of the object takes its pixels out of the mask, and counts as a distractor."""
    front = rectangle(16, 10, 26, 40)
    found = labelled(OBJECT, SURE, hiding=front)
    np.testing.assert_array_equal(found.mask, OBJECT & (1 - front))
    np.testing.assert_array_equal(found.foreign, front)
    assert found.answer[:4] == (300, 900, 600, 600)


@pytest.mark.parametrize(("side", "kept"), [(10, "all"), (20, "cross"), (30, "square")])
def test_what_is_thin_is_no_part_of_a_large_object(side: int, kept: str) -> None:
    """Opening by nothing, a cross or a square, by the area of the object; exactly OpenCV's."""
    body = rectangle(4, 4, 4 + side, 4 + side)
    whole = body | rectangle(4 + side, 8, 14 + side, 9) | rectangle(8, 4 + side, 11, 12 + side)
    whole[4 + side, 4 + side] = whole[5 + side, 5 + side] = 1
    odds = np.where(whole != 0, 2.0, -2.0).astype(np.float32)
    mask = labelled(body, odds, warped=odds).mask
    elements = {"cross": cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3)), "square": np.ones((3, 3), np.uint8)}
    wanted = whole if kept == "all" else cv2.morphologyEx(whole, cv2.MORPH_OPEN, elements[kept])
    np.testing.assert_array_equal(mask, wanted)


def test_the_component_that_overlaps_is_the_object() -> None:
    """Of three parts, two overlap with where the object was; the third is none, and its odds are lowered."""
    large, small, foreign = rectangle(16, 10, 46, 28), rectangle(16, 32, 46, 38), rectangle(2, 36, 12, 46)
    odds = np.where((large | small | foreign) != 0, 2.0, -2.0).astype(np.float32)
    found = labelled(OBJECT, odds, warped=odds)
    np.testing.assert_array_equal(found.mask, large | small)
    assert found.raw[40, 6] > 0
    assert found.odds[40, 6] == -1.0


def test_of_two_parts_elsewhere_none_is_the_object() -> None:
    """A single one is believed."""
    one, two = rectangle(2, 2, 10, 8), rectangle(50, 38, 60, 46)
    for parts, wanted in ((one | two, np.zeros_like(one)), (two, two)):
        odds = np.where(parts != 0, 2.0, -2.0).astype(np.float32)
        np.testing.assert_array_equal(labelled(OBJECT, odds, warped=odds).mask, wanted)


def mixed_edge(alpha: float) -> NDArray[np.float32]:
    """Object of 200 on a ground of 100, its left column mixed: a share `alpha` of object."""
    image = np.where(OBJECT[:, :, np.newaxis] != 0, 200.0, 100.0).astype(np.float32) * np.ones(3, np.float32)
    image[10:40, 16] = 100.0 + 100.0 * alpha
    return image


@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize(("alpha", "cut"), [(0.2, True), (0.45, True), (0.55, False), (0.9, False)])
def test_mixed_pixels_go_to_whom_they_show_more_of(alpha: float, cut: bool, known: bool) -> None:
    """By the background known there, or by its surroundings; the odds tell how mixed they are."""
    counts = np.full((3, H, W), 9.0 if known else 0.0, np.float32)
    background = np.full((H, W, 3), 100.0 if known else 0.0, np.float32)
    found = labelled(OBJECT, SURE, image=mixed_edge(alpha), background=background, counts=counts)
    assert found.mask[22, 16] == (0 if cut else 1)
    np.testing.assert_array_equal(found.mask[:, 17:], OBJECT[:, 17:])
    wanted = min(float(found.raw[22, 16]), 8 * (alpha - 0.5)) if alpha < 0.7 else float(found.raw[22, 16])
    assert found.odds[22, 16] == pytest.approx(wanted, abs=1e-3)


def test_an_edge_that_would_take_too_much_is_not_cut() -> None:
    """Where more must be left than would be, mask and odds are as they were."""
    found = labelled(OBJECT, SURE, image=mixed_edge(0.2), left=1.0)
    np.testing.assert_array_equal(found.mask, OBJECT)
    np.testing.assert_array_equal(found.odds, found.raw)


def test_colours_count_by_how_much_they_tell() -> None:
    """The object's own colour raises the odds, the ground's lowers them; the same in both says nothing."""
    image = np.full((H, W, 3), 20.0, np.float32)
    image[:, 32:] = 220.0
    dark, light = 0, 6 * 64 + 6 * 8 + 6
    colours = np.zeros((2, colour.BINS), np.float32)
    colours[0, dark] = colours[1, light] = 1.0
    nothing = np.zeros((H, W), np.float32)
    found = labelled(OBJECT, nothing, image=image, warped=nothing, colours=colours, weight=0.7)
    np.testing.assert_array_equal(found.bins, np.where(image[:, :, 0] < 32, dark, light))
    np.testing.assert_allclose(found.raw, np.where(found.bins == dark, 1.54, -1.54), rtol=1e-4)
    same = labelled(OBJECT, nothing, image=image, warped=nothing, colours=colours[[0, 0]], weight=0.7)
    np.testing.assert_allclose(same.raw, 0.0, atol=1e-6)


def random_histograms() -> NDArray[np.float32]:
    """Histograms of object and background with some colours in common and many in none."""
    found = np.random.default_rng(6).gamma(0.1, size=(2, colour.BINS))
    found[found < 1e-4] = 0.0
    return np.asarray(found / found.sum(axis=1, keepdims=True), np.float32)


def test_likelihood_is_a_clipped_logarithm() -> None:
    """To the precision of float32; with it the overlap of the histograms."""
    colours = random_histograms()
    ratio = np.empty(colour.BINS, np.float32)
    overlap = kernels.likelihood(colours, ratio)
    a, b = colours.astype(float)
    wanted = np.log((a + 1e-3) / (b + 1e-3))
    assert (np.abs(wanted) > 2).sum() > 20
    assert (np.abs(wanted) < 1).sum() > 20
    np.testing.assert_allclose(ratio, np.clip(wanted, -2, 2), atol=2e-6)
    assert overlap == pytest.approx(np.sqrt(a * b).sum(), abs=1e-6)


def smoothed(counts: NDArray[Any]) -> NDArray[np.float64]:
    """Counts (512) smoothed along blue, green and red by (0.15, 0.7, 0.15), and made shares."""
    taps = 0.7 * np.eye(8) + 0.15 * (np.eye(8, k=1) + np.eye(8, k=-1))
    cube = np.einsum("ai,bj,ck,ijk->abc", taps, taps, taps, counts.reshape(8, 8, 8).astype(float))
    return np.asarray(cube.ravel() / cube.sum())


def test_histograms_are_smoothed_and_blended() -> None:
    """Towards the counts by the rate; one without pixels stays as it is."""
    rng = np.random.default_rng(7)
    before, counts = random_histograms(), rng.integers(0, 9, (2, colour.BINS)).astype(np.float32)
    wanted = [old + 0.1 * (smoothed(new) - old) for old, new in zip(before, counts, strict=True)]
    out = np.empty_like(before)
    kernels.blend(before, counts.copy(), 0.1, out)
    np.testing.assert_allclose(out, wanted, atol=1e-7)
    counts[0] = 0.0
    kernels.blend(before, counts.copy(), 0.1, out)
    np.testing.assert_array_equal(out[0], before[0])
    np.testing.assert_allclose(out[1], wanted[1], atol=1e-7)


def test_histograms_of_counts_alone() -> None:
    """Shares that sum to one; the counts stay as they are."""
    counts = np.random.default_rng(8).integers(0, 9, (2, colour.BINS)).astype(np.float32)
    kept = counts.copy()
    found = colour.histograms(counts)
    np.testing.assert_array_equal(counts, kept)
    np.testing.assert_allclose(found, [smoothed(one) for one in counts], atol=1e-7)


class Learned(NamedTuple):
    """What `kernels.learn` gave."""

    answer: tuple[Any, ...]
    ground: NDArray[np.float32]
    colours: NDArray[np.float32]


def learned(
    mask: Mask, own: Mask, foreign: Mask | None, image: NDArray[np.float32], bins: NDArray[np.int16]
) -> Learned:
    """Learn from a frame on a known background of 100, the object expected in `own` and found in `mask`."""
    odds = np.where(mask != 0, 2.0, -2.0).astype(np.float32)
    zero, obj = np.zeros((H, W), np.float32), np.zeros((H, W, 3), np.float32)
    errors = np.stack((odds, np.abs(image[:, :, 0] - 100.0), zero + 1, zero)).astype(np.float32)
    ground, counts = np.full((H, W, 3), 100.0, np.float32), np.full((3, H, W), 9.0, np.float32)
    colours = random_histograms()
    outs = [np.empty_like(one) for one in (odds, obj, zero, ground, counts, colours)]
    answer = kernels.learn(
        kernels.Window(image, np.array((4, 2, W - 2, H - 6))),
        image,
        kernels.Expected(image, obj, odds, zero, own, np.array((0, 0, W, H))),
        errors,
        kernels.Labels(bins, odds, odds, mask, foreign),
        kernels.Ground(ground, counts),
        kernels.Learning(colours=colours, shape_rate=0.1, colour_rate=0.1, freeze=False, hidden=False),
        kernels.Memory(*outs),
    )
    return Learned(answer, outs[3], outs[5])


def test_ground_is_learned_outside_the_object_and_its_surroundings() -> None:
    """Not within two pixels of where the object is or was expected, and only inside the frame."""
    mask, own = OBJECT, rectangle(20, 10, 50, 40)
    image = np.full((H, W, 3), 102.0, np.float32)
    near = cv2.dilate(mask | own, np.ones((5, 5), np.uint8))
    inside = rectangle(4, 2, W - 2, H - 6)
    found = learned(mask, own, None, image, np.zeros((H, W), np.int16))
    np.testing.assert_array_equal(found.ground[:, :, 0] != 100.0, (near == 0) & (inside == 1))
    assert found.answer[:2] == (np.count_nonzero((near == 0) & (inside == 1)), 0)
    assert found.answer[2] == pytest.approx(2.0)


def test_a_distractor_is_no_noise() -> None:
    """Its pixels are outside the object, but what they differ by is not the noise of the ground."""
    image = np.full((H, W, 3), 102.0, np.float32)
    other = rectangle(48, 2, 62, 42)
    image[other != 0] = 180.0
    arguments = (image, np.zeros((H, W), np.int16))
    _, strange, spread = learned(OBJECT, OBJECT, other, *arguments).answer
    assert strange == np.count_nonzero(other & (1 - cv2.dilate(OBJECT, np.ones((5, 5), np.uint8))))
    assert spread == pytest.approx(2.0)
    assert learned(OBJECT, OBJECT, None, *arguments).answer[2] == pytest.approx(80.0)


def test_colours_are_learned_of_object_and_ground() -> None:
    """Sure pixels of the mask count for the object, what is outside its surroundings for the ground."""
    bins = np.where(OBJECT != 0, 7, 300).astype(np.int16)
    bins[cv2.dilate(OBJECT, np.ones((5, 5), np.uint8)) > OBJECT] = 500
    found = learned(OBJECT, OBJECT, None, np.full((H, W, 3), 100.0, np.float32), bins)
    for which, bin_seen in enumerate((7, 300)):
        counts = np.zeros(colour.BINS)
        counts[bin_seen] = 1.0
        before = random_histograms()[which]
        np.testing.assert_allclose(found.colours[which], before + 0.1 * (smoothed(counts) - before), atol=1e-7)


@pytest.mark.parametrize("everywhere", [True, False])
def test_explaining_is_moving_and_weighing(everywhere: bool) -> None:
    """One call gives what the two kernels give that it is made of."""
    rng = np.random.default_rng(9)
    previous, obj, image, background, moved = rng.uniform(0, 255, (5, H, W, 3)).astype(np.float32)
    odds, shape = rng.uniform(-3, 4, (H, W)).astype(np.float32), rng.uniform(0, 1, (H, W)).astype(np.float32)
    counts = rng.integers(0, 9, (3, H, W)).astype(np.float32)
    inverse, part = np.array((1.02, 0.01, -3.3, -0.02, 0.98, 2.6)), np.array((5, 0, W - 4, H - 7))
    inside = np.array((3, 4, W, H - 2))
    kinds = [(previous, np.float32), (obj, np.float32), (odds, np.float32), (shape, np.float32), (odds, np.uint8)]
    one, two = ([np.empty(like.shape, kind) for like, kind in kinds] for _ in range(2))
    errors, fresh = np.empty((2, 4, H, W), np.float32), np.empty((2, H, W), np.uint8)
    layer, scene = kernels.Layer(obj, odds, shape), kernels.Scene(image, inside, moved, background, counts)
    expected, seen = kernels.Expected(*one, part), kernels.Evidence(errors[0], fresh[0])
    kernels.carry(previous, layer, counts, inverse, everywhere, expected)
    wanted = kernels.evidence(scene, expected, LIKELIHOOD, seen)
    expected, seen = kernels.Expected(*two, part), kernels.Evidence(errors[1], fresh[1])
    found = kernels.warp_and_score(scene, previous, layer, inverse, everywhere, LIKELIHOOD, expected, seen)
    assert found == wanted
    for mine, other in ((one, two), (errors[:1], errors[1:]), (fresh[:1], fresh[1:])):
        for a, b in zip(mine, other, strict=True):
            np.testing.assert_array_equal(a, b)
    assert 0.0 < found < 1.0


@pytest.mark.parametrize(
    ("odds", "seen_before", "ground"),
    [
        (-1.0, True, True),  # outside the object, as in the last frame: the light has changed since it was learned
        (-1.0, False, False),  # outside the object, but new: the object may have grown
        (1.0, True, False),  # of the object, which may be at rest
    ],
)
def test_ground_that_has_changed_is_ground_outside_the_object(odds: float, seen_before: bool, ground: bool) -> None:
    """A known background is wrong by 40 gray levels: what the last frame shows tells ground from object."""
    rng = np.random.default_rng(3)
    known = rng.uniform(60, 160, (H, W, 3)).astype(np.float32)
    image = np.ascontiguousarray(known[::-1]) + np.float32(40.0)
    before = image if seen_before else known
    planes, fresh = np.empty((4, H, W), np.float32), np.empty((H, W), np.uint8)
    whole = np.array((0, 0, W, H))
    belief, own = np.full((H, W), odds, np.float32), np.full((H, W), odds > 0, np.uint8)
    kernels.evidence(
        kernels.Scene(image, whole, before, known, np.full((3, H, W), 9.0, np.float32)),
        kernels.Expected(before, image, belief, own.astype(np.float32), own, whole),
        LIKELIHOOD,
        kernels.Evidence(planes, fresh),
    )
    assert np.mean((planes[0] < 0.0) == ground) > 0.99


def test_light_is_the_median_ratio_round_the_object(rng: np.random.Generator) -> None:
    """The same bits as by NumPy; too dark and too bright pixels tell nothing, nor does the object."""
    before, now = (rng.uniform(0, 255, (H, W, 3)).astype(np.float32) for _ in range(2))
    now[5:20, 7:30] = 1000.0
    thinned = np.s_[::3, ::3]
    beside = np.ones((H, W), bool)
    beside[5:20, 7:30] = False
    told = beside & (before.min(axis=2) > 20) & (now.min(axis=2) > 4) & (now.max(axis=2) < 250)
    told, ratios = told[thinned], (now / before)[thinned]
    pixels, ratio = kernels.measure_light(now, before, (7, 5, 30, 20), 3, (20.0, 4.0, 250.0))
    assert pixels == np.count_nonzero(told) > 0
    np.testing.assert_array_equal(np.array(ratio, np.float32), np.median(ratios[told], axis=0))
    assert kernels.measure_light(now, before, (0, 0, W, H), 3, (20.0, 4.0, 250.0)) == (0, [1.0, 1.0, 1.0])


@pytest.mark.parametrize(("dx", "dy"), [(0, 0), (3, -2), (-W, 1), (2, H + 5)])
def test_where_the_object_was_there_is_no_ground(rng: np.random.Generator, dx: int, dy: int) -> None:
    """Its pixels move with the shift; what comes from beyond the window is kept."""
    image, odds = rng.uniform(0, 255, (H, W, 3)).astype(np.float32), np.full((H, W), -1.0, np.float32)
    odds[10:20, 15:30] = 2.0
    out = np.empty_like(image)
    kernels.without_object(image, odds, dx, dy, 1.0, -999.0, out)
    hidden = np.zeros((H, W), bool)
    hidden[max(10 - dy, 0) : max(20 - dy, 0), max(15 - dx, 0) : max(30 - dx, 0)] = True
    np.testing.assert_array_equal(out, np.where(hidden[:, :, np.newaxis], np.float32(-999.0), image))
