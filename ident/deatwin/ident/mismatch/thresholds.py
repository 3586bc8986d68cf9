"""Limits that several steps of a diagnosis share; a limit of one step stands beside it."""

import numpy as np

SIGNIFICANCE = 0.01
"""Probability of a false alarm in each decision whether something is missing or faulty."""
CHANCE = 0.05
"""Probability of a false statement on where a mismatch is, and beyond a one-sided bound."""
CREDIBLE = 0.95
"""Total probability that an answer and its alternatives must reach, so that many weak alternatives count together; and
largest probability of a cause, however certain the evidence. Of 48 causes named in a study of concealed physics (long
recordings, seed 2006) two were wrong, where evidence alone predicted one in ten thousand. This gives 0.5 to 14 %
(95 %), so the remaining 5 % are a margin, not an estimate."""
STRONG = float(np.log(20.0))
"""Log evidence ratio, in nats, beyond which an alternative is excluded (Kass & Raftery 1995: strong evidence)."""
DISTINGUISHED = 16.0
"""Smallest d² of distinguished explanations: the wrong one is chosen in 2.3 % of all recordings."""
DEVIATIONS = 2.0
"""Half width of an interval, in standard deviations, where these are not known well enough for an exact quantile."""

MOST = 0.5
"""Share of a whole above which a part is most of it."""
NEARLY_ALL = 0.9
"""Share of a whole above which a part is nearly all of it. At worst the law of a mechanism is right to about 30 % of
its contribution, which is 9 % of its power."""
CLEARLY_LESS = 0.8
"""Ratio of two powers below which the first is clearly smaller."""
PRACTICAL_SHARE = 0.1
"""Smallest share that counts: of the noise's power, which is not known more accurately, and of what a step improves."""
NEGLIGIBLE = 1e-3
"""Share of a whole below which a part affects no decision, and is not shown: of a squared residual, it is a tenth of a
nat in a hundred blocks."""
LOUDER = 2.0
"""Ratio of a burst's noise level to the usual one; a window of white noise reaches it less than once in 60 000."""

BLOCK_SAMPLES = 50
"""Samples of a block, about a second, after which the residuals of most plants are nearly independent."""
FEWEST_SAMPLES = 200
"""Smallest number of samples from which a noise level or the origin of a mismatch is concluded."""
SEGMENT_SAMPLES = 256
"""Length of a segment for a spectrum."""
STRETCHES = 20
"""Number of stretches from which a standard deviation is estimated; each is longer than most correlation times."""
WINDOW_SECONDS, MOST_WINDOWS = 2.0, 2000
"""Shortest length of a stretch of time, s, and largest number of them: work grows with its square."""
SETTLING_SECONDS = 1.0
"""Time in which a plant comes to rest, s."""
MOVES = 0.02
"""Share of the command's range above which the command moves."""

FEW, SEVERAL, MANY = 3, 4, 6
"""Numbers of candidates that a search tries: of those that fits recommend, rough fits, and first-order scores."""
MOST_TERMS = 4
"""Largest number of terms of a function that is sought in a residual."""

ACCURACY = 1e-6
"""Relative accuracy of simulations and of recorded numbers: a smaller relative difference is none."""
ROUNDING = 1e-9
"""Relative size of rounding errors in sums over all samples."""
TINY = 1e-300
"""Smallest divisor, and smallest number whose logarithm is taken."""
