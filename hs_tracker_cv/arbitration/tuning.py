"""The numbers of arbitration: what each is, and its unit.

Where they were chosen: on `drawn:160:101`, `standard` and the 22 real sequences of choose.txt (three starts each)
unless a line says otherwise; docs/tuning.md lists them all.
"""

from __future__ import annotations

WITNESS_FRAMES = 20
"""Frames after the start in which both modes run, and the size of the carried box can be relied on."""

LEAST = 0.25
"""Chance of being right below which nothing is believed."""

SURELY = 0.9
"""Chance from which the carried box answers for a segmentation that sees nothing: it was right in 78 of 78 frames."""

SURE = 0.8
"""Score from which the carried box may take over from a segmentation that is doubted, and its size is compared.
Chosen on `develop`, `compressed` and the first 150 frames of all real sequences."""

ASK_EVERY = 8
"""Frames between two questions to a carried box that rides on a segment: where would it be on its own?"""

ASKED_RATE = 0.5
"""Share of one answer to that question in the mean size difference. On the 22 real sequences,
exact and six starts each, and `drawn:117:41001` and `41002`, exact and from boxes off by ±10 %."""

WATCH_EVERY = 2
"""Frames between two measurements of the background of an object whose segmentation is not trusted."""

UNDERSTOOD = 0.06
"""Share of the background not explained below which what is new in the scene may be searched for the object."""

SIGHTED = 0.45
"""Score while a part of the object is seen: so often its box overlapped the truth by half (vanish suites)."""

WHOLE = 0.8
"""Share of the object seen from which segmentation begins anew there."""

PATIENCE = 60
"""Frames of another scene after which the object is looked for there, too: the camera may have been moved."""

CERTAINLY = 0.95
"""Chance from which the carried box is believed in a frame that seems to be of another scene: in cuts between real
sequences .9 was too little (4 % of the answers True), .97 gave what .95 gives."""

LIMIT = -7.55
"""Sum of the three measurements from which segmentation is doubted. This, the two weights, `EARLY` and the numbers of
spin: on `drawn:117:41001` and `41002`, exact and from boxes off by ±10 %, `drawn/rotate_in_place:30:41003` and the 22
real sequences."""

SIZE_WEIGHT = 2.0
"""Weight of the size difference beside the log share of the background not explained."""

STEADY = 0.005
"""Added to the unsteadiness of the segment, so that its logarithm, the third of them, is finite."""

EARLY = 2.0
"""By how much doubt of a segment that leads is put off in the first frame, and ever less until `WITNESS_FRAMES`."""

SPIN_WEIGHT, FAST_SPIN = 15.0, 0.06
"""Weight of the turn against doubt, and turn from which it does not rise, radians per frame."""

SPINNING = 0.03
"""Mean turn, radians per frame, from which the patch tracker is no witness."""

WOBBLING = 2.0
"""How many times the mean distance of single turns from it that is, where an object turns steadily: the turn of a
segment that swells comes and goes. On the 22 real sequences, six starts each, which 1.5 and 2.5 serve alike."""

SPUN_CHANCE, SPUN_AGREEMENT = 0.5, 0.6
"""Chance and agreement taken for the least it may say then."""

FLOOR = 0.01
"""Added to the share of the background, so that its logarithm is finite."""

RATE = 0.05
"""Share of one frame in the running mean of that logarithm, once it is less than that of a plain mean."""

LEAVE, RETURN = 0.0, -0.8
"""Doubt from which segmentation is left, and below which it is followed again."""

FIRST_SWITCH = 6
"""Frames measured before segmentation is left."""

TOGETHER, ALIKE = 0.9, 0.25
"""Agreement above which and size difference below which both modes say the same: then doubt says nothing."""

APART, RATHER = 0.5, 0.6
"""Agreement below which and chance from which the carried box contradicts a segment."""

LIKELY = 0.7
"""Chance from which the carried box takes over from a segment that is doubted."""

SEGMENT_OFFSET, SEGMENT_CHANCE, SEGMENT_SCORE, SEGMENT_AGREEMENT, SEGMENT_DOUBT = -6.8, 0.84, 0.6, 8.2, -0.8
"""Logistic fit of the chance that a segment is right: constant, weights of the log-odds of the carried box's chance
and of the segment's own score, of the agreement, and of the doubt."""

LEAST_ODDS, MOST_ODDS = 0.02, 0.98
"""Chances below and above which it makes no difference."""

LEFT_AGREEMENT, LEFT_SCORE, LEFT_DOUBT = 0.75, 0.5, 0.5
"""Agreement below which, score of the segment above which and doubt below which it is asked whether the object has
left the carried box: where that holds only ground, it is begun anew. On `drawn:117:73111`, `95940` and `99498`."""

PLACE_WEIGHT = 1.5
"""How fast agreement falls with the distance of two boxes, per root of their mean area."""

ELSEWHERE = 0.5
"""IoU with what is seen of the whole object below which a mode has found something else."""

RELOCATED_FROM = 3
"""Frames of segmentation from which its layer is looked for farther away."""
