"""The numbers of segmentation: what each is, and its unit; pixels are those of the lattice.

Where they were chosen: on suite `develop` unless a line says otherwise, with single sequences of `standard` and
`heldout` in view; those of the first frames also on draws of another renderer and on `drawn:160:101`. The parameters
in `state.SegmentationParams` belong to them; docs/tuning.md lists them all.
"""

from __future__ import annotations

# Window

FIRST_MARGIN = 16.0
"""Least margin round a box just drawn, px: its motion is unknown."""

UNSEEN_MARGIN = 12.0
"""Least margin while the object is unseen, px; the share of its side and the frames unseen come on top."""

LEAST_MARGIN = 10.0
"""Least margin otherwise, px."""

SUDDEN = 2.0
"""Change of speed that the margin has room for, px per frame."""

BEYOND_FRAME = 12
"""Px that a window may reach beyond the frame."""

LEAST_WINDOW = 24
"""Shortest side of a window, px."""

WINDOW_UNIT = 4
"""Sides of windows are multiples of it, px: flow is planned once per size."""

LARGEST, SMALLEST = 1.4, 0.4
"""Longest side of the object, in working sizes, from which the lattice is made coarser, and below which finer."""

# Light

FAINTEST, BRIGHTEST = 0.02, 50.0
"""Light that is believed, times that of the first frame."""

LIGHT_STRIDE = 3
"""One in so many pixels across and down tells the light."""

UNLIT, SATURATED = 20.0, 250.0
"""Gray levels before and now: what is darker or brighter tells nothing of the light."""

UNLIT_NOW = 4.0
"""Gray levels now, below which a pixel tells nothing of the light."""

LIGHT_PIXELS = 60
"""Pixels below which nothing is told."""

SAME_LIGHT = 0.004
"""Relative change of light that is none."""

# Motion

POINTS = 2400
"""Room for pixels that motion is measured by; large windows have more."""

OBJECT_STEPS, CAMERA_STEPS = 3, 3
"""Most steps of Gauss–Newton, of the object and of the camera."""

MOVING_YOUNG = 10
"""Frames in which what moves with the object is still being found out."""

CHANGE_FLOOR = 0.01
"""Weight of a pixel of a new box that has not changed yet, of 1."""

CHANGE, SURE_CHANGE = 3.0, 9.0
"""Mean square over 3 × 3 pixels, noise²: least change, and what is added for a sure one."""

REST = 0.12
"""Px per frame: a camera that moves less stands still."""

SMALLEST_RADIUS = 6.0
"""Half of the longest side by which motion is normalised, px, at least."""

STRANGE_NOISE, STRANGE = 4.0, 8.0
"""Residual that is nothing like the object: so many times the noise, and gray levels."""

LINEAR_CONTRAST = 0.2
"""Px of motion that the linear parts of a motion count as, per unit."""

FULL_CONTRAST = 0.4
"""Px per frame against the camera from which the contrast is full."""

CONTRAST_MEMORY = 0.9
"""Share of the contrast that stays from frame to frame."""

SEARCH_FACTOR, SEARCH_ADDED = 1.5, 1.0
"""Residual of the prediction from which translations are searched too: times its mean, and gray levels."""

HARDLY_VISIBLE = 0.1
"""Visible share of a hidden object's box below which it moves as it did."""

FIRST_GAIN, FIRST_LESS = 0.92, 0.15
"""A translation found must cost less than this times the prediction, less gray levels; in the first frame."""

LATER_GAIN, LATER_LESS = 0.85, 0.5
"""The same in later frames."""

FAR_FACTOR, FAR_ROOM = 8.0, 8.0
"""How far a translation may be for twice the cost: the square of half the object and so many px, times the factor."""

FAR_PENALTY = 0.005
"""Gray levels per px² from the expected place."""

HALVED = 24
"""Longest side from which translations are searched for at half the resolution, px."""

FLOW_SWEEPS = 5
"""Iterations per warp of the flow."""

FLOW_LEAST_SIDE = 8.0
"""Shorter sides count as this, px, when the levels of the pyramid are counted."""

FLOW_COARSEST = 10.0
"""Shortest side on the coarsest level, px."""

FLOW_LEVELS = 3
"""Most levels."""

MOTION_RATE = 0.6
"""Share of the measured velocity in the next prediction."""

HIDDEN_RATE = 0.05
"""The same while the object is occluded."""

LINEAR_RATE = 0.5
"""Share of the measured linear motion in the next prediction; the rest is forgotten."""

COAST_SLOWDOWN = 0.9
"""Factor per frame of an unseen object's speed, once it is unseen for long."""

RESIDUAL_RATE = 0.15
"""Share of one frame in the mean residual of the prediction."""

# Evidence and mask

TAU_OBJECT = 0.35
"""Error of the object layer per unit of gradient, px."""

TAU_WHOLE, TAU_FRACTION = 0.15, 0.3
"""The same of the background, where the camera moved by whole pixels, and otherwise."""

REACH = 4
"""Px round what may be the object, for gradients and sums over 5 × 5."""

SURELY_OBJECT = 3.0
"""Log-odds from which a pixel was the object and no ground was seen there."""

NOWHERE = 1e4
"""Gray levels: unlike anything."""

KAPPA_COLOUR = 1.8
"""Three channels tell more than one, but not three times as much."""

GROUND_GAINS = (0.35, 2.5)
"""Local changes of the background's brightness that are believed, from and to: shadow, light."""

OBJECT_GAINS = (0.6, 1.7)
"""The same of the object's."""

GROWTH = 4
"""How far the object may grow in a frame, px."""

LEAST_LEFT = 0.6
"""Share of the mask that must be left when its edge is cut."""

NEVER = -3.0
"""Log-odds where nothing is known of the object."""

SMALLEST_MOVER = 20
"""Px of a second mover; less has no flow of its own."""

MOVER_NOISE, MOVER_ADDED = 3.0, 3.0
"""Error up to which a pixel is still the second mover's: times the noise, and gray levels."""

MOVER_BETTER = 0.6
"""It must be so many times that of the object layer at most."""

# Occlusion

SPEEDS = 12
"""Frames of velocity that are remembered."""

SIZES = 8
"""Frames back to the size of an object that may already be going out of sight."""

SPAN = 4
"""Frames over which a side must have moved."""

SPAN_LEAST, SPAN_SHARE = 2.0, 0.3
"""Px that a side should have moved there, from which it has stalled with less than this share."""

UNCONFIRMED = 12
"""Frames after which a suspicion is dropped."""

WHOLE = 0.95
"""Visible share from which nothing covers the object."""

HALF = 0.5
"""Visible share below which something does, whatever the sides say."""

RESHAPED = 0.3
"""Overlap with the remembered shape above which a changed form counts as visible by its area."""

MUCH_SEEN = 0.3
"""Visible share from which a long occlusion is not believed."""

LEADING = 0.25
"""Px per frame from which a side leads."""

FALSIFIED, REMEMBERED = 3, 6
"""Last velocities that the occlusion falsified, and how many before them are remembered."""

FAR = 40
"""Px: farthest an unseen object is looked for from where it is expected."""

NEARBY, PER_SUSPECTED = 8, 0.2
"""Px to begin with, and more for each frame of suspicion."""

DIFFERENT = 4.0
"""Error of the background, in units of its likelihood, from which a pixel may be the object coming out."""

FEWEST_DIFFERENT = 0.05
"""Share of the shape that must be different at least."""

SEARCH_STRIDE = 12
"""Px of reach per px of the search's stride."""

BETTER, BETTER_ADDED, ENOUGH = 1.1, 0.04, 0.12
"""A place found must score so many times what staying does, so much more, and so much at least."""

USABLE_CONTRAST = 0.2
"""Contrast of motion below which nothing is concluded of occlusion."""

SHAPE_YOUNG = 5
"""Frames before which the shape is too little known to conclude from what is missing of it."""

COVERED = 0.05
"""Share of the shape that a second mover must hide to be in front of it."""

# What is seen at all

UNSEEN = 0.12
"""Visible share below which the object counts as out of sight."""

ALIKE = 0.2
"""Of what is taken for the object so much must look about as it did."""

GONE, BACK = 0.85, 0.5
"""Misfit from which the object is not there, and up to which it is back."""

ALIKE_ENOUGH = 0.6
"""Share of it that looks as it did from which the score does not suffer."""

NOTHING = 0.02
"""Visible share below which that is believed at once."""

SCORE_OFFSET, SCORE_VISIBLE, SCORE_UNEXPLAINED = 2.5, 3.0, 0.7
"""Logistic fit of the score: constant, weights of log visible and of log unexplained share. Fitted on `develop` and
`vanish_develop`."""

VISIBLE_FLOOR, UNEXPLAINED_FLOOR = 0.05, 0.01
"""Added to these shares, so that the logarithms are finite."""

# Memory

SEED_RIM, SEED_RIM_ODDS = 1.12, -2.0
"""How far round a new box, in half sides, the ground is less sure; its log-odds there."""

SEED_BOX_ODDS = 0.4
"""Log-odds in the corners of a new box."""

SEED_ELLIPSE, SEED_ODDS = 0.95, 1.0
"""Its ellipse, of the inscribed one, and the log-odds there."""

SEED_COLOURS = 0.9
"""Part of the ellipse whose colours are the object's."""

SPREAD_TO_NOISE = 1.3 / 1.54
"""σ of the noise by the 85th percentile of |I − B|, not the median: compression leaves most pixels alone and errs
badly near edges. The factor is that of the median (1.3) where both tell the same, in Gaussian noise."""

LEAST_NOISE, MOST_NOISE = 1.2, 14.0
"""Range of σ, gray levels."""

NOISE_RATE = 0.2
"""Share of one frame in σ."""

COLOUR_RATE = 0.1
"""Share of one frame in the histograms."""

YOUNG = 12
"""Frames in which the shape is still learned fast."""

YOUNG_RATE, SHAPE_RATE = 0.3, 0.08
"""Share of one frame in the shape, then and later."""

HIDDEN_SLOPE, HIDDEN_LEAST, HIDDEN_MOST = 8.0, -2.0, 1.0
"""Log-odds of a hidden object per unit of its shape, and their range."""

LEAST_GAIN, MOST_GAIN = 0.5, 1.8
"""Change of brightness of the whole background that is believed."""

SAME_GAIN = 0.004
"""The same, up to which it is none."""

# Relocation (after frames in which nothing could be seen)

LEAST_TURN = 0.02
"""Rad: an object that has turned less is not turned."""

LEAST_REACH, MOST_REACH = 24.0, 160.0
"""Px to each side that are searched."""

REACH_SPEED, REACH_ADDED = 1.5, 8.0
"""The same by its velocity: times the way it should have gone, and px."""

COARSE = 24
"""Px: a larger template is searched for at half the resolution."""

RESIDUAL, RESIDUAL_FACTOR = 6.0, 2.0
"""Residual that is believed at most: gray levels, and times that of tracking."""

RIVAL = 1.15
"""The best other place has at least so many times the residual."""

# Departure. Its numbers: on `drawn:117:73111`, `95940` and `99498` and the 22 real sequences of choose.txt.

STAYED = 0.5
"""Share of the segment's way over the ground up to which another box has stayed."""

LEFT_DIFFERENCE, LEFT_NOISE = 4.0, 1.5
"""Difference from which a pixel is unlike another: in units of the noise, and the least noise, gray levels."""

LEFT_SHARE = 0.03
"""Share of the first box that must have been the object's and show ground now."""

LEFT_TO_GROUND = 0.7
"""Share of the pixels that were the object's which must look as the ground."""

LEFT_THERE = 0.2
"""Pixels that look as in the first frame and not as the ground, at most so many times those of which the reverse is
true."""

GROUND_KNOWN, GROUND_ALIKE = 0.5, 0.9
"""Share of a box that must be known ground, and of that, which must look as the ground does, where it shows ground
alone. On `drawn/empty:60:51001` and the 22 real sequences; .75 for the latter gives the same."""
