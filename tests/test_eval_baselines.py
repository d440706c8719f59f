"""The baselines do what they are for: beating a weak one would prove nothing."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from eval.accuracy import Job, run_one
from eval.baselines.background_model import BackgroundModel
from eval.baselines.frame_differencing import FrameDifferencing
from eval.baselines.opencv import KCF, PrimedKCF
from eval.baselines.regions import noise_threshold
from eval.baselines.template_matching import TemplateMatching
from eval.framesource import FrameSource
from eval.metrics import iou_per_frame
from eval.results import COMPLETED
from eval.sequences import Sequence
from eval.trackers import DEFAULT_TRACKERS, TRACKERS, code_version, find_tracker
from eval.worker import resolve
from tests.tiny_networks import VIT_SPAN, write_dasiamrpn, write_vit

SIZE = (200, 150)
Frames = list[NDArray[np.uint8]]
Boxes = list[tuple[float, float, float, float]]


def noise(rng: np.random.Generator, height: int, width: int, sigma: float) -> NDArray[np.float32]:
    """Smooth texture in 0–255."""
    field = cv2.GaussianBlur(rng.standard_normal((height, width, 3)).astype(np.float32), (0, 0), sigma)
    return np.asarray(cv2.normalize(field, None, 0, 255, cv2.NORM_MINMAX), dtype=np.float32)


def film(
    rng: np.random.Generator,
    *,
    count: int = 25,
    step: tuple[float, float] = (3.0, 1.0),
    growth: float = 1.0,
    gray: bool = False,
) -> tuple[Frames, Boxes]:
    """A textured square that moves, and grows by a factor per frame, over a still textured ground, with noise."""
    ground, square = noise(rng, SIZE[1], SIZE[0], 4.0) * 0.6, 50 + noise(rng, 64, 64, 2.0) * 0.75
    frames, boxes = [], []
    for index in range(count):
        side = 36.0 * growth**index
        x, y = 20 + step[0] * index, 30 + step[1] * index
        matrix = np.array([[side / 64, 0, x], [0, side / 64, y]])
        mask = cv2.warpAffine(np.ones((64, 64), dtype=np.float32), matrix, SIZE)[..., np.newaxis]
        image = ground * (1 - mask) + cv2.warpAffine(square, matrix, SIZE) * mask
        pixels = np.clip(image + rng.normal(0, 2, image.shape), 0, 255).astype(np.uint8)
        frames.append(pixels[:, :, 1].copy() if gray else pixels)
        boxes.append((x, y, side, side))
    return frames, boxes


def follow(tracker: Any, frames: Frames, boxes: Boxes) -> NDArray[np.float64]:
    """IoU of each frame but the first."""
    tracker.init(frames[0], tuple(round(value) for value in boxes[0]))
    answers = [tracker.update(frame) for frame in frames[1:]]
    found = np.array([box if ok else (np.nan,) * 4 for ok, box in answers])
    return iou_per_frame(np.array(boxes[1:]), found, SIZE)


ALL = pytest.mark.parametrize("make", [TemplateMatching, FrameDifferencing, BackgroundModel])


@ALL
@pytest.mark.parametrize("gray", [False, True])
def test_a_moving_square_is_followed(make: Callable[[], Any], gray: bool, rng: np.random.Generator) -> None:
    """On a still ground every one of them keeps the square, in colour and in gray."""
    overlap = follow(make(), *film(rng, gray=gray))
    assert overlap.mean() > 0.75
    assert overlap.min() > 0.4


def test_templates_follow_scale(rng: np.random.Generator) -> None:
    """A square that grows by half is followed by matching over scales, and a template of one size could not."""
    overlap = follow(TemplateMatching(), *film(rng, growth=1.018))
    assert overlap.mean() > 0.85
    assert overlap[-1] > 0.75


def test_templates_are_exact_to_a_fraction_of_a_pixel(rng: np.random.Generator) -> None:
    """A motion of fractions of a pixel is not rounded."""
    frames, boxes = film(rng, step=(1.37, 0.61), count=15)
    tracker = TemplateMatching()
    tracker.init(frames[0], tuple(round(value) for value in boxes[0]))
    last = [tracker.update(frame)[1] for frame in frames[1:]][-1]
    centre = np.array(last[:2]) + np.array(last[2:]) / 2
    assert np.abs(centre - (np.array(boxes[-1][:2]) + 18)).max() < 0.6


def test_templates_say_when_the_target_is_gone_and_find_it_again(rng: np.random.Generator) -> None:
    """``ok=False`` while another picture is shown, and True with the right box when it is back."""
    frames, boxes = film(rng, step=(0.5, 0.0), count=12)
    hidden = np.clip(noise(rng, SIZE[1], SIZE[0], 4.0) * 0.6, 0, 255).astype(np.uint8)
    frames[5:8] = [hidden] * 3
    tracker = TemplateMatching()
    tracker.init(frames[0], (20, 30, 36, 36))
    answers = [tracker.update(frame) for frame in frames[1:]]
    assert [ok for ok, _ in answers] == [True] * 4 + [False] * 3 + [True] * 4
    assert iou_per_frame(np.array(boxes[-1:]), np.array([answers[-1][1]]), SIZE)[0] > 0.8


def test_differencing_holds_a_stopped_object(rng: np.random.Generator) -> None:
    """Nothing moves for a while: the box stays where it is."""
    frames, boxes = film(rng, count=12)
    ground = frames[-1].astype(np.float32)
    still = [np.clip(ground + rng.normal(0, 1, ground.shape), 0, 255).astype(np.uint8) for _ in range(12)]
    overlap = follow(FrameDifferencing(), frames + still, boxes + [boxes[-1]] * 12)
    assert overlap[-1] > 0.7


def test_differencing_takes_the_camera_out(rng: np.random.Generator) -> None:
    """A shaking camera moves the whole frame, and only the object is followed."""
    frames, boxes = film(rng, step=(3.0, 0.5))
    shifts = rng.integers(-3, 4, (len(frames), 2))
    shifts[0] = 0
    shaken = [np.roll(frame, tuple(shift), axis=(0, 1)) for frame, shift in zip(frames, shifts, strict=True)]
    moved = [(x + dx, y + dy, w, h) for (x, y, w, h), (dy, dx) in zip(boxes, shifts, strict=True)]
    assert follow(FrameDifferencing(), shaken, moved).mean() > 0.6


@pytest.mark.parametrize("sigma", [1.0, 5.0, 12.0])
def test_the_threshold_follows_the_noise(sigma: float, rng: np.random.Generator) -> None:
    """Of pure noise next to nothing is over it, whatever its strength."""
    difference = np.abs(rng.normal(0, sigma, (200, 200))).astype(np.float32)
    assert (difference > noise_threshold(difference)).mean() < 1e-3


@ALL
def test_the_border_is_survived(make: Callable[[], Any], rng: np.random.Generator) -> None:
    """A target that leaves the frame, or starts at its edge, raises nothing."""
    frames, boxes = film(rng, step=(12.0, 4.0))
    follow(make(), frames, boxes)
    tracker = make()
    tracker.init(frames[0], (0, 0, SIZE[0], SIZE[1]))
    tracker.update(frames[1])
    tracker = make()
    tracker.init(frames[0], (SIZE[0] - 6, SIZE[1] - 6, 6, 6))
    for frame in frames[1:]:
        tracker.update(frame)


def test_kcf_is_blind_in_its_first_update_unless_it_is_primed(rng: np.random.Generator) -> None:
    """The baseline is given its best: as shipped it is off by the first motion or gives up; primed it is right."""
    frames, boxes = film(rng, count=6, step=(6.0, 4.0))
    right: dict[Any, list[bool]] = {KCF: [], PrimedKCF: []}
    for make, found in right.items():
        tracker = make()
        tracker.init(frames[0], tuple(round(value) for value in boxes[0]))
        for frame, truth in zip(frames[1:], boxes[1:], strict=True):
            ok, box = tracker.update(frame)
            found.append(ok and max(abs(a - b) for a, b in zip(box[:2], truth[:2], strict=True)) <= 2.0)
    assert all(right[PrimedKCF])
    assert not any(right[KCF])


MODELS = ("net_backbone.onnx", "net_head.onnx", "object_tracking_vitTrack.onnx")


@pytest.fixture
def models(tmp_path: Path) -> Path:
    """A folder of files that are named as models are."""
    for name in (*MODELS, *(f"dasiamrpn_{part}.onnx" for part in ("model", "kernel_cls1", "kernel_r1"))):
        (tmp_path / name).write_bytes(name.encode())
    return tmp_path


def test_trackers_with_models_find_their_files(models: Path) -> None:
    """By the ends of their names; what is missing or doubtful is said."""
    assert find_tracker("TrackerNano", models).params == {
        "backbone": str(models / "net_backbone.onnx"),
        "neckhead": str(models / "net_head.onnx"),
    }
    assert find_tracker("TrackerVit", models).params == {"net": str(models / MODELS[2])}
    assert sorted(find_tracker("DaSiamRPN", models).params) == ["kernel_cls1", "kernel_r1", "model"]
    with pytest.raises(ValueError, match=r"TrackerVit needs model files: --models DIR with \*vit\*track\*\.onnx"):
        find_tracker("TrackerVit")
    (models / "v2_head.onnx").touch()
    with pytest.raises(
        ValueError, match=r"expected one file like \*head\*\.onnx .* found net_head.onnx, v2_head.onnx"
    ):
        find_tracker("TrackerNano", models)
    (models / MODELS[0]).unlink()
    with pytest.raises(ValueError, match=r"expected one file like \*backbone\*\.onnx in .*, found none"):
        find_tracker("TrackerNano", models)


def test_a_model_counts_by_its_bytes_and_not_by_its_place(
    models: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """The same file elsewhere gives the same results, another one of the same name does not."""
    before = code_version(find_tracker("TrackerNano", models))
    other = tmp_path_factory.mktemp("elsewhere")
    for name in MODELS:
        (other / name).write_bytes((models / name).read_bytes())
    assert code_version(find_tracker("TrackerNano", other)) == before
    (other / MODELS[0]).write_bytes(b"trained anew")
    assert code_version(find_tracker("TrackerNano", other)) != before


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """Parameters that OpenCV's trackers with models are made with; none is loaded."""
    given: dict[str, Any] = {}
    monkeypatch.setenv("OPENCV_FORCE_DNN_ENGINE", "")  # DaSiamRPN's is meant for a process of its own
    for name in ("Nano", "Vit", "DaSiamRPN"):
        create = f"Tracker{name}_create"
        monkeypatch.setattr(cv2, create, lambda each, name=name: given.__setitem__(name, each), raising=False)
    return given


@pytest.mark.skipif(not hasattr(cv2, "TrackerVit_Params"), reason="TrackerVit came with OpenCV 4.9")
def test_vit_is_made_as_shipped_and_with_the_deviations_of_its_training(models: Path, made: dict[str, Any]) -> None:
    """OpenCV gets the file, and either its own deviations or ours."""
    shipped = cv2.TrackerVit_Params().stdvalue
    for name, deviations in (("TrackerVit", shipped), ("TrackerVit-normalised", (0.07433, -0.07598, -0.07565, 0.0))):
        spec = find_tracker(name, models)
        resolve(spec.factory)(**spec.params)
        assert made["Vit"].net == str(models / MODELS[2])
        assert made["Vit"].stdvalue == pytest.approx(deviations)


@pytest.mark.parametrize("name", ["TrackerNano", "DaSiamRPN"])
def test_trackers_with_models_are_made_of_them(name: str, models: Path, made: dict[str, Any]) -> None:
    """OpenCV gets the files."""
    spec = find_tracker(name, models)
    resolve(spec.factory)(**spec.params)
    given = made[name.removeprefix("Tracker")]
    assert {parameter: getattr(given, parameter) for parameter in spec.params} == dict(spec.params)


def still(folder: Path, colour: tuple[int, ...]) -> Sequence:
    """Four frames of 320 × 240 px of one colour (gray if it is one number), and a box of 40 px in the middle."""
    frames = np.tile(np.array(colour, np.uint8), (4, 240, 320, 1))
    place = folder / "frames" / "still.npy"  # beside the networks: a tracker may read those only
    place.parent.mkdir()
    np.save(place, frames[..., 0] if len(colour) == 1 else frames)
    boxes = np.tile([140.0, 100, 40, 40], (4, 1))
    source = FrameSource((str(place),), "array", 4)
    return Sequence("still", source, boxes, np.ones(4), (), (320, 240), "x")


@pytest.mark.skipif(not hasattr(cv2, "TrackerVit_Params"), reason="TrackerVit came with OpenCV 4.9")
def test_what_vit_sees_is_what_it_was_trained_on_by_our_deviations_only(tmp_path: Path) -> None:
    """A network that answers with what it sees: (value - mean) / deviation, and as shipped something else.

    Where TrackerVit as shipped passes, OpenCV has mended it, and TrackerVit-normalised and its note have to go.
    """
    write_vit(tmp_path / "vittrack.onnx")
    level, window = 180, 4 * 40
    normalised = (level / 255 - 0.456) / 0.224, (level / 255 - 0.406) / 0.225
    expected = [window * (0.5 + value / VIT_SPAN) for value in normalised]
    right, sequence = {}, still(tmp_path, (level, level, level))
    for name in ("TrackerVit", "TrackerVit-normalised"):
        run = run_one(Job(find_tracker(name, tmp_path), sequence))
        assert run.status == COMPLETED
        # The window follows the size that is found: the first answer says what was seen.
        right[name] = np.abs(run.trajectory.boxes[1, 2:] - expected).max() <= 1.0
        assert run.trajectory.score[1] == pytest.approx(0.9, abs=0.02)
    assert right == {"TrackerVit": False, "TrackerVit-normalised": True}


@pytest.mark.parametrize("colour", [(90, 180, 150), (120,)])
def test_dasiamrpn_goes_through(colour: tuple[int, ...], tmp_path: Path) -> None:
    """Its layers are found, in OpenCV 5 as well, and networks that see nothing let the box stand, gray or not."""
    write_dasiamrpn(tmp_path)
    run = run_one(Job(find_tracker("DaSiamRPN", tmp_path), still(tmp_path, colour)))
    assert run.status == COMPLETED
    np.testing.assert_array_equal(run.trajectory.boxes, np.tile([140.0, 100, 40, 40], (4, 1)))
    np.testing.assert_array_equal(run.trajectory.score[1:], 0.5)


@pytest.mark.skipif(not hasattr(cv2, "TrackerVit_Params"), reason="TrackerVit came with OpenCV 4.9")
def test_vit_takes_gray_frames_and_says_what_is_no_network(models: Path) -> None:
    """A gray frame has three equal channels; a file that is no network is OpenCV's error in the run's status."""
    sequence = still(models, (120,))
    status = run_one(Job(find_tracker("TrackerVit", models), sequence)).status
    assert status.startswith("raised error: OpenCV")
    write_vit(models / MODELS[2])
    assert run_one(Job(find_tracker("TrackerVit", models), sequence)).status == COMPLETED


def test_none_of_them_is_a_default() -> None:
    """Nor is TrackerHS with another flow."""
    assert not set(DEFAULT_TRACKERS) & {"Oracle", "TrackerNano", "TrackerVit", "DaSiamRPN", "TrackerHS+DIS"}
    assert "CSRT" in DEFAULT_TRACKERS


@pytest.mark.real
def test_tracker_nano_follows_a_square(real: Path, rng: np.random.Generator) -> None:
    """With the files of ../shared/models, where they are."""
    try:
        spec = find_tracker("TrackerNano", real.parent / "models")
    except ValueError as error:
        pytest.skip(str(error))
    tracker = resolve(spec.factory)(**spec.params)
    scene = cv2.GaussianBlur(rng.uniform(0, 255, (240, 320, 3)).astype(np.uint8), (0, 0), 3)
    square = rng.uniform(0, 255, (40, 40, 3)).astype(np.uint8)
    for step in range(10):
        frame = scene.copy()
        frame[100:140, 100 + 3 * step : 140 + 3 * step] = square
        if step == 0:
            tracker.init(frame, (100, 100, 40, 40))
        else:
            _, box = tracker.update(frame)
    assert abs(box[0] + box[2] / 2 - 147) < 8


@pytest.mark.parametrize("name", ["KCF", "KCF-primed", "MOSSE", "CSRT"])
def test_cv2_trackers_run_on_gray_frames(name: str, tmp_path: Path) -> None:
    """Gray sequences go through with every tracker of cv2."""
    ground = cv2.GaussianBlur(np.random.default_rng(3).uniform(0, 255, (96, 128)), (0, 0), 2.0)
    frames = np.stack([np.roll(ground, 2 * index, axis=1) for index in range(4)])
    frames = cv2.normalize(frames, None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)
    np.save(tmp_path / "gray.npy", frames)
    boxes = np.array([[40.0 + 2 * index, 30, 32, 32] for index in range(4)])
    source = FrameSource((str(tmp_path / "gray.npy"),), "array", 4)
    gray = Sequence("gray", source, boxes, np.ones(4), (), (128, 96), "x")
    assert run_one(Job(TRACKERS[name], gray)).status == COMPLETED
