"""Error of a rule over that of a baseline in the same CPU seconds, with its interval."""

from collections.abc import Sequence

import numpy as np

from dmis.experiment.convergence import Interval, Measure
from dmis.experiment.metrics import mean_and_error
from dmis.experiment.runs import Run


def equal_time_ratio(rule: Sequence[Run], baseline: Sequence[Sequence[Run]], measure: Measure = "mse") -> Interval:
    """Return the error of a rule over that of the baseline in the same CPU seconds.

    The error of low-discrepancy points falls faster than 1 / time, so the ratio of error times CPU seconds is not the
    ratio in equal time where the rule's seconds differ from the baseline's. Here the baseline's error at time T is read
    off its line in log-log between the two nearest budgets, beyond the last on that line's continuation:

        log B(T) = (1 - x) log B_1 + x log B_2,  x = log(T / T_1) / log(T_2 / T_1)

    Parameters
    ----------
    rule
        Runs of one number of samples, one per seed.
    baseline
        Runs of the baseline by number of samples, each one per seed. With a single number of samples its error is taken
        to fall as 1 / time.
    measure
        Which error: ``mse`` or ``relmse``.

    Returns
    -------
    The ratio of means over seeds, with a Student's interval of its logarithm. The scatter of the rule's errors and of
    the baseline's is in it. All is NaN where an error is not above 0; the ends are NaN for one seed.
    """
    from scipy.stats import t  # imported where used: scipy.stats takes half a second

    at = np.log(np.median([run.cpu_seconds for run in rule]))
    budgets = [(np.log(np.median([run.cpu_seconds for run in runs])), runs) for runs in baseline]
    budgets.sort(key=lambda budget: budget[0])
    k = int(np.clip(np.searchsorted([seconds for seconds, _ in budgets], at), 1, max(1, len(budgets) - 1)))
    (low, first), (high, second) = budgets[k - 1], budgets[min(k, len(budgets) - 1)]
    if len(budgets) == 1:
        terms, slope_one = [(1.0, rule), (-1.0, first)], at - low
    else:
        x = (at - low) / (high - low)
        terms, slope_one = [(1.0, rule), (x - 1, first), (-x, second)], 0.0
    factors = np.array([factor for factor, _ in terms])
    means, errors = np.array([mean_and_error(np.array([getattr(run, measure) for run in runs])) for _, runs in terms]).T
    if not (means > 0).all():
        return Interval(np.nan, np.nan, np.nan)
    value = factors @ np.log(means) + slope_one
    # degrees of freedom of a sum of variances (Welch 1947): (sum s_i^2)^2 / sum (s_i^4 / (K_i - 1))
    variances, degrees = (factors * errors / means) ** 2, np.array([len(runs) - 1 for _, runs in terms])
    half = float("nan")
    if degrees.min() > 0:
        total = variances.sum()
        of_all = total**2 / np.sum(variances**2 / degrees) if total > 0 else degrees.min()
        half = t.ppf(0.975, of_all) * np.sqrt(total)
    with np.errstate(over="ignore"):  # two seeds whose times hardly differ know no upper end
        return Interval(*np.exp([value, value - half, value + half]).tolist())
