"""The numbers of the patch tracker: what each is, and its unit; cells and samples are relative to the object.

Where they were chosen: on nine real sequences (docs/results.md names them) and `vanish` unless a line says otherwise;
those of the finder on the 22 of choose.txt, from the exact box and from one off by up to ±10 %. The parameters in
`state.PatchTrackerParams` belong to them; docs/tuning.md lists them all.
"""

from __future__ import annotations

# Finder: the correlation filter

CELLS = 40
"""Cells along a side of the window; each is 4 × 4 samples. The native kernels are compiled for it."""

WINDOW = 5.0
"""Side of the window, in roots of the box's area."""

SIGMA = 1.0 / 16.0
"""Width of the wanted response, in roots of the box's area."""

INSIDE, OUTSIDE = 1e-6, 1e10
"""Penalties on the square of the filter, in the box and outside it."""

THIN = 0.75
"""Cells that half of a thin object has at least."""

AROUND = 0.65
"""Half sides of the part that is not surroundings, in sides of the box."""

MEMORY = 15.0
"""Weight of the last filter."""

COUPLING, COUPLING_GROWTH, ROUNDS = 1.0, 10.0, 2
"""Weight of the alternating directions, its factor from round to round, and rounds."""

CHANGED, MOVES = 32.0, 10.0
"""Gray levels from which a change is full in the channel that shows it, and counts as that of a moving thing."""

DIMMED = 0.65
"""By how much channels are dimmed where nothing moves, while the camera stands still."""

STILL, SHAKEN = 1.5, 3.0
"""Gray levels by which surroundings change from which a camera does not count wholly, and not at all, as still."""

UNREST_RATE, UNREST_SHARE = 0.1, 0.7
"""Share of one frame in their mean change, and the rank of the change that counts."""

LEVEL_LEAST = 0.1
"""Least height of a peak against its mean that makes a difference."""

SECOND_MOST = 1.2
"""Highest second peak that makes a difference, in heights of the first."""

CHANCE, CHANCE_LEVEL, CHANCE_SECOND, CHANCE_WITNESS = 4.5, 1.4, -7.2, 1.6
"""Logistic fit of the chance that a peak is right: constant, weights of log height, second peak, witness. Fitted on
choose.txt and, for a sixth of its weight, `vanish_develop`."""

# Search

LOOKS = 3
"""Places asked per frame, of a lost object. Chosen on the vanish suites, as the next two."""

PLACES = 200
"""Places asked before beginning again."""

LEAST_REACH = 16
"""Steps to each side that are listed at least."""

APART = 1.9
"""Distance of places, box sides."""

PENALTY_FADE = 0.5
"""How much less distance costs with each frame of bad agreement: 1 / (1 + this × frames)."""

SAME_TURN = 0.02
"""Rad: a smaller turn makes no difference."""

CLEAR = 0.9
"""Chance from which no other angle is tried."""

# Patch

BODY, BODY_INNER = 0.9, 0.85
"""Half axes of the weights of the flow and of comparisons, in half boxes."""

BEYOND = 1.1
"""Half boxes from which a sample is of the surroundings."""

MIDDLE = 0.45
"""Half sides, in box sides, of the part whose colours are the object's."""

KEPT_BODY = 1.2
"""Square of half boxes up to which a sample is watched for persistence."""

MASK_FLOOR = 0.15
"""Weight in the fit of the flow of a pixel that never moved with the object."""

KEPT_FLOOR = 0.1
"""Weight in comparisons of a pixel that is not the object's any more."""

COLOUR_THRESHOLD = 2.0
"""Mean difference of blue and red from which a first frame has colours, gray levels."""

KNOWN_WINDOW = 0.42
"""Part of the finder's window, to each side, that the frame before must show."""

SPARE = 1.1
"""How much more is cut than is needed."""

LARGEST = 8.0
"""Objects larger than that many frames are no objects."""

# Carry, hold, learn

WORSE = 0.02
"""Loss of agreement from which what the flow says is not taken."""

TRUST_FROM, TRUST_SPAN = 0.3, 0.4
"""Agreement from which the flow's place is trusted, and from there to full trust."""

MAX_TURN = 0.15
"""Rad: largest turn taken from one flow field."""

KEY_MATCH = 0.7
"""Agreement from which a keyframe is matched."""

SIZE_FROM, SIZE_SPAN = 0.5, 0.4
"""Agreement from which a change of size is taken, and from there to all of it."""

MIN_SIDE, MOST_OF_FRAME = 6.0, 0.9
"""Mean side that is believed: least px, and share of the frame's longest side at most."""

ZOOMS = (0.67, 0.75, 0.87, 1.0, 1.15, 1.33, 1.5, 1.7)
"""Sizes tried, one per frame, when the first keyframe is not matched; relative."""

LEAST_VISIBLE = 0.2
"""Share of the box inside the frame below which nothing is believed."""

PEAK_RATE = 0.05
"""Share of one good frame in the mean height of the peak."""

NEW_KEY_AGREEMENT = 0.6
"""Agreement with the mean patch that a new keyframe needs."""

CLEARLY = 0.1
"""Coherence by which what goes on in the box must exceed what leapt out of it."""

COHERENCE_SLOPE, COHERENCE_OFFSET = 1.5, 0.5
"""Share of what is kept by coherence, in units of `coherent`: slope, and what is taken off."""

COAST = 0.5
"""Factor of the velocity in a frame that was not good."""

RIDE_RATE = 0.03
"""Share of another mode's size that is taken over per frame."""

LEAST_TURN = 0.025
"""Rad per frame: less is within the error of its measurement, and within what the finder bears."""
