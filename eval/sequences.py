"""A sequence: frames by reference, true boxes, visible fraction, attributes, a content hash; and those of the suites.

Those of data sets are read by :mod:`eval.datasets`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from .framesource import FrameSource
from .regions import Mask
from .rendered import digest_of, text_of
from .truthfiles import SequenceError

if TYPE_CHECKING:
    from datasets_synthetic import SequenceSpec

__all__ = ["Sequence", "canonical_suite", "from_spec", "load_suite", "suite_folder"]


@dataclass(frozen=True)
class Sequence:
    """A video with its truth.

    Parameters
    ----------
    name : str
    frames : FrameSource
        T frames.
    boxes : ndarray, shape (T, 4), float64
        True boxes x, y, w, h, px, 0-based, of the whole object; NaN where there is none.
    visibility : ndarray, shape (T,), float64
        Visible fraction of the object, 0–1. Real data sets say only 0 or 1; NaN where nobody knows.
    attributes : tuple of str
    size : (int, int)
        Width and height of the frames, px.
    digest : str
        Hash of the frames and the truth.
    parameters : mapping of str to str or number
        Of one drawn from a distribution: what was drawn.
    scene : str
        What it shares with others that are no independent evidence beside it: one camera, one video. By default its
        own name: it shares nothing.
    regions : tuple of str
        Of each frame the mask or rotated box, as :mod:`eval.regions` writes them, empty where there is only a box;
        no entries where no frame has one.
    by_region : bool
        Whether the regions are what is to be found, with boxes that are only drawn round them, as in VOT and COCO:
        then protocols that are VOT's judge them. The laboratory's boxes are of the whole object, its masks of what
        can be seen of it: there the boxes are judged.
    """

    name: str
    frames: FrameSource
    boxes: NDArray[np.float64]
    visibility: NDArray[np.float64]
    attributes: tuple[str, ...]
    size: tuple[int, int]
    digest: str
    parameters: Mapping[str, str | float] = field(default_factory=dict)
    scene: str = ""
    regions: tuple[str, ...] = ()
    by_region: bool = False

    @property
    def theme(self) -> str:
        """Of one drawn from a distribution: the theme; else empty."""
        return str(self.parameters.get("theme", ""))

    def __post_init__(self) -> None:
        object.__setattr__(self, "scene", self.scene or self.name)
        if self.boxes.shape != (len(self), 4) or self.visibility.shape != (len(self),):
            raise SequenceError(
                f"{self.name}: {len(self)} frames, but boxes {self.boxes.shape}, visibility {self.visibility.shape}"
            )
        if self.regions and len(self.regions) != len(self):
            raise SequenceError(f"{self.name}: {len(self)} frames, but {len(self.regions)} regions")
        if len(self) < 2:
            raise SequenceError(f"{self.name}: expected at least 2 frames, got {len(self)}")
        if not np.isfinite(self.boxes[0]).all():
            raise SequenceError(f"{self.name}: frame 0 has no box to start from")

    def __len__(self) -> int:
        """Number of frames T."""
        return self.frames.count

    def cut(self, count: int | None) -> Sequence:
        """Return the first `count` frames; all for None."""
        if count is None or count >= len(self):
            return self
        return replace(
            self,
            frames=replace(self.frames, count=count),
            boxes=self.boxes[:count],
            visibility=self.visibility[:count],
            regions=self.regions[:count],
            digest=f"{self.digest}-{count}",
        )


# --- suites ------------------------------------------------------------------------------------------------


def canonical_suite(name: str) -> str:
    """Name of a suite in which the seed is a number, taken from the clock where it was not given.

    Raises
    ------
    SequenceError
        If there is no suite of that name; the message lists the known ones.
    """
    from datasets_synthetic import canonical

    try:
        return canonical(name)
    except ValueError as error:
        raise SequenceError(str(error)) from error


def suite_folder(name: str) -> str:
    """Name of the folder for results of a suite: draws of one seed share theirs, however many they are."""
    kind, *numbers = name.split(":")
    return "-".join([kind.replace("/", "-"), *numbers[1:]])


def load_suite(name: str) -> list[Sequence]:
    """Sequences of a synthetic suite: their truth; the frames are rendered when they are asked for.

    Parameters
    ----------
    name : str
        Name of a suite, `drawn:N:SEED` or `drawn/THEME:N:SEED`.

    Raises
    ------
    SequenceError
        If there is no suite of that name; the message lists the known ones.
    """
    from datasets_synthetic import suite

    return [from_spec(spec) for spec in suite(canonical_suite(name))]


def from_spec(spec: SequenceSpec) -> Sequence:
    """Sequence of the laboratory: its truth; the frames are rendered when they are asked for."""
    from datasets_synthetic import parameters, truth

    digest, known = digest_of(spec), truth(spec)
    source = FrameSource((text_of(spec), digest), "drawn", spec.frames)
    shown = parameters(spec) if spec.theme else {}
    regions = tuple(Mask(*mask).text for mask in known.masks)
    return Sequence(
        spec.name, source, known.boxes, known.visibility, spec.attributes, spec.size, digest, shown, regions=regions
    )
