"""The suites: which sequences there are, as a literal table."""

from __future__ import annotations

from .spec import Actor, Camera, Deform, Effect, Motion, Path, Scene, SequenceSpec, Shadow, Texture

__all__ = ["SUITES"]

_SMOKE = (
    SequenceSpec(
        name="smoke_move",
        target=Actor("ellipse", (36, 28), Texture("patches", seed=3), Motion(Path("line", (38, 50), (118, 72)))),
        scene=Scene(Texture("gravel", seed=1)),
        size=(160, 120),
        frames=28,
        seed=101,
        attributes=("translation",),
    ),
    SequenceSpec(
        name="smoke_rotate",
        target=Actor("polygon", (40, 36), Texture("coffee", seed=2), Motion(Path("hold", (80, 60)), spin=7.0), seed=4),
        scene=Scene(Texture("grass", seed=2)),
        size=(160, 120),
        frames=28,
        seed=102,
        attributes=("rotation",),
    ),
    SequenceSpec(
        name="smoke_deform",
        target=Actor(
            "blob",
            (40, 40),
            Texture("clouds", seed=5),
            Motion(Path("line", (112, 46), (52, 70))),
            deform=(Deform("squash", 0.22, 1.5),),
            shadow=Shadow((5, 6)),
            seed=2,
        ),
        scene=Scene(Texture("brick", seed=3)),
        size=(160, 120),
        frames=28,
        seed=103,
        attributes=("deformation", "shadow"),
    ),
    SequenceSpec(
        name="smoke_occlude",
        target=Actor("box", (34, 30), Texture("chelsea", seed=6), Motion(Path("line", (30, 62), (128, 58)))),
        scene=Scene(
            Texture("camera", seed=4),
            front=(Actor("bar", (14, 140), Texture("speckle", seed=7), Motion(Path("hold", (82, 60)))),),
        ),
        camera=Camera(jitter=0.4),
        effects=(Effect("noise", 2.0), Effect("gray")),
        size=(160, 120),
        frames=28,
        seed=104,
        attributes=("occlusion", "jitter", "gray"),
    ),
)

SUITES: dict[str, tuple[SequenceSpec, ...]] = {"smoke": _SMOKE}
