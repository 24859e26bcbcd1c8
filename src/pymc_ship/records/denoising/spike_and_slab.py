"""Compiled kernels of :mod:`pymc_ship.records.denoising.ebayes`; ``a`` is the Laplace scale, nan for quasi-Cauchy.

s = max(x - a, 0)^2/2, R(z) = Phi(z)/phi(z), M the Mills ratio: exp(-s) R(x - a) and exp(-s) M(x + a) are bounded.
"""

import math

import numpy as np
from numba import njit, vectorize

SCALE_BOX = (0.04, 3.0)  # range in which the scale of the Laplace density is estimated [1 / noise sd]
_GRID = np.linspace(math.log(SCALE_BOX[0]), math.log(SCALE_BOX[1]), 10)
_ROOT_TWO_PI = math.sqrt(2.0 * math.pi)
_SMALLEST = 1e-300
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(8)
# cells of sizes: of one width up to _FAR, from there of one ratio; the poles of the densities are about 0.6 away
_WIDTH, _FAR, _RATIO = 0.25, 8.0, 1.15
_NEAR = round(_FAR / _WIDTH)
_POINTS = 14  # Chebyshev points of a cell
_ANGLES = (np.arange(_POINTS) + 0.5) * math.pi / _POINTS
_TO_COUNTS = np.cos(np.outer(np.arange(_POINTS), _ANGLES)) * (2.0 - (np.arange(_POINTS) == 0))[:, None] / _POINTS
# (1 + t) M(t) in powers of (t - 5)/(t + 5), highest first: the form of Shepherd & Laframboise, Math. Comp. 36:249, 1981
_MILLS = np.array(
    [
        *(-9.564832934712551e-10, -7.073898575561589e-10, 1.1032071151574336e-08, 9.092476134019147e-09),
        *(-7.758520236786343e-08, -6.588974491108954e-08, 4.91996233147834e-07, 3.2054316652589574e-07),
        *(-3.277287633208865e-06, -1.7633239265736746e-07, 2.270961270923768e-05, -2.480583845192319e-05),
        *(-0.0001343742785571135, 0.00045704392357953655, 1.9530638370790786e-05, -0.004201290329187307),
        *(0.01634823128102938, -0.03802659218584139, 0.0615050458401865, -0.0661776007790963),
        *(0.0250721793016388, 0.07778159886873769, -0.22948753825211315, 1.1568486282918946),
    ]
)
_jit = njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})


@_jit
def _mills(t: float) -> float:
    """Mills ratio M(t) = (1 - Phi(t)) / phi(t) for t >= 0, to 3e-16."""
    s = (t - 5.0) / (t + 5.0)
    fourth = (s * s) * (s * s)
    a, b, c, d = _MILLS[0], _MILLS[1], _MILLS[2], _MILLS[3]
    for k in range(4, 24, 4):  # four sums that a processor takes at the same time
        a, b = a * fourth + _MILLS[k], b * fourth + _MILLS[k + 1]
        c, d = c * fourth + _MILLS[k + 2], d * fourth + _MILLS[k + 3]
    return (((a * s + b) * s + c) * s + d) / (t + 1.0)


@_jit
def _laplace_sides(z: float, near: float, far: float) -> tuple[float, float, float, float]:
    """exp(-s) times R(z), M(x + a) and 1, from z = x - a, M(|z|) and M(x + a); and s."""
    if z <= 0.0:
        return near, far, 1.0, 0.0
    s = 0.5 * z * z
    null = math.exp(-s)
    return _ROOT_TWO_PI - near * null, far * null, null, s


@_jit
def _densities(x: float, a: float) -> tuple[float, float, float, float]:
    """exp(-s) times (1 + beta, odds, 1) at x >= 0, and s; the odds are 1/w - 1 for the weight w of threshold x."""
    if not math.isnan(a):
        plus, minus, null, s = _laplace_sides(x - a, _mills(abs(x - a)), _mills(x + a))
        return 0.5 * a * (plus + minus), 0.5 * a * (plus - minus), null, s
    s = 0.5 * x * x
    null = math.exp(-s)
    slab = 0.5 if s == 0.0 else -math.expm1(-s) / (2.0 * s)
    if x > 1.0:
        return slab, math.erf(x / math.sqrt(2.0)) / (2.0 * s) - 2.0 * null / (_ROOT_TWO_PI * x), null, s
    term, odds = 2.0 * x / _ROOT_TWO_PI / 3.0, 0.0
    for k in range(5, 35, 2):
        odds += term
        term *= x * x / k
    return slab, odds * null, null, s


@_jit
def _tail_quantile(log_tail: float) -> float:
    """Find t >= 0 with log(sqrt(2 pi) (1 - Phi(t))) = log_tail, by Halley's method, whose error is cubed."""
    # the root of the first two powers of t at 0
    t = math.sqrt(2.0 / math.pi + 2.0 * max(math.log(0.5 * _ROOT_TWO_PI) - log_tail, 0.0)) - math.sqrt(2.0 / math.pi)
    for _ in range(50):
        mills = _mills(t)
        excess = math.log(mills) - 0.5 * t * t - log_tail
        step = mills * excess / (1.0 + 0.5 * excess * (1.0 - t * mills))
        t = max(t + step, 0.0)
        if abs(step) <= 1e-5 * (1.0 + t):
            break
    return t


@_jit
def _laplace_median(x: float, w: float, a: float) -> float:
    """Posterior median at x >= 0 beyond the threshold, from the smaller tail."""
    z = x - a
    plus, minus, null, _ = _laplace_sides(z, _mills(abs(z)), _mills(x + a))
    tail = null * (1.0 - w) / (w * a) + 0.5 * (plus + minus)
    if z <= 0.0:
        return z + _tail_quantile(math.log(tail) - 0.5 * z * z)
    if tail <= 0.5 * _ROOT_TWO_PI:
        return z + _tail_quantile(math.log(tail))
    return max(z - _tail_quantile(math.log(_ROOT_TWO_PI - tail)), 0.0)


@_jit
def _cauchy_median(x: float, w: float) -> float:
    """Posterior median at x >= 0 beyond the threshold: Newton's method within a bracket."""
    _, odds, null, s = _densities(x, math.nan)
    if x > 1e5:
        return x - 2.0 / x
    if x < 0.5:
        return _cauchy_median_near_zero(x, 0.5 * (odds / null - (1.0 - w) / w))
    low, high = 0.0, x
    middle = 0.5 * x if x < 3.0 else x - 2.0 / x
    target = 0.5 * (1.0 + null) - s * null * (1.0 - w) / w
    for _ in range(200):
        density = math.exp(-0.5 * (x - middle) ** 2) / _ROOT_TWO_PI
        mills = _mills(middle)
        slab = 1.0 - middle * mills
        excess = target - density * (_mills(x - middle) + x * slab + mills)
        if excess > 0.0:
            low = middle
        else:
            high = middle
        new = middle + excess / (x * x * density * slab)
        if not low < new < high:
            new = 0.5 * (low + high)
        if abs(new - middle) <= 1e-15 * x:
            break
        middle = new
    return middle


@_jit
def _cauchy_median_near_zero(x: float, target: float) -> float:
    """Median for small x: root m of int_0^m exp(ux - u^2/2) gamma(u) du = target, by 8-point quadrature."""
    m = target * _ROOT_TWO_PI
    for _ in range(50):
        total = 0.0
        for k in range(8):
            u = 0.5 * m * (1.0 + _NODES[k])
            total += 0.5 * m * _WEIGHTS[k] * math.exp(u * (x - 0.5 * u)) * (1.0 - u * _mills(u))
        step = (target * _ROOT_TWO_PI - total) / (math.exp(m * (x - 0.5 * m)) * (1.0 - m * _mills(m)))
        m += step
        if abs(step) <= 1e-15:
            break
    return m


@vectorize(cache=True)
def mean_value(x: float, w: float, a: float) -> float:
    """Posterior mean."""
    size = abs(x)
    slab, _, null, s = _densities(size, a)
    weight = w * slab / (w * slab + (1.0 - w) * null) if w > 0.0 else 0.0
    if math.isnan(a):
        if s > 0.5:
            return weight * x * (0.5 / slab - 1.0) / s
        term, total = 0.5, 0.0
        for k in range(3, 20):
            total += term
            term *= -s / k
        return weight * x * total / (2.0 * slab)
    plus, minus, _, _ = _laplace_sides(size - a, _mills(abs(size - a)), _mills(size + a))
    return math.copysign(weight * (size - a * (plus - minus) / (plus + minus)), x)


@vectorize(cache=True)
def median_value(x: float, w: float, a: float, limit: float) -> float:
    """Posterior median, known to be zero up to the limit."""
    size = abs(x)
    if size <= limit:
        return 0.0
    if size - a > 6.0 and math.exp(-0.5 * (size - a) ** 2) * (1.0 - w + w * a) < 1e-17 * w * a:
        return math.copysign(size - a, x)
    _, odds, null, _ = _densities(size, a)
    if w * odds <= (1.0 - w) * null:
        return 0.0
    return math.copysign(_cauchy_median(size, w) if math.isnan(a) else _laplace_median(size, w, a), x)


@_jit
def _laplace_draw(x: float, a: float, tail: float) -> float:
    """Quantile of the slab's posterior at x >= 0 with upper tail probability ``tail``: a draw for a uniform tail."""
    z = x - a
    plus, minus, _, _ = _laplace_sides(z, _mills(abs(z)), _mills(x + a))
    right = tail * (plus + minus) / plus
    if right > 1.0:
        below = max((1.0 - tail) * (plus + minus) / minus, _SMALLEST)
        return x + a - _tail_quantile(math.log(below * _mills(x + a)) - 0.5 * (x + a) ** 2)
    right = max(right, _SMALLEST)
    if z <= 0.0:
        return z + _tail_quantile(math.log(right * plus) - 0.5 * z * z)
    if right * plus <= 0.5 * _ROOT_TWO_PI:
        return z + _tail_quantile(math.log(right * plus))
    return max(z - _tail_quantile(math.log(_ROOT_TWO_PI - right * plus)), 0.0)


@_jit
def _cauchy_draw(x: float, uniform: float, normal: float) -> float:
    """Draw from the slab's posterior at x: p(t) ~ exp(-t x^2/2) on (0, 1), the mean given t is N((1 - t) x, 1 - t)."""
    s = 0.5 * x * x
    t = uniform if s < 1e-12 else -math.log1p(uniform * math.expm1(-s)) / s
    return (1.0 - t) * x + math.sqrt(max(1.0 - t, 0.0)) * normal


@vectorize(cache=True)
def draw_value(x: float, w: float, a: float, uniform: float, normal: float) -> float:
    """Draw from the posterior, from a uniform and (for the quasi-Cauchy density) a normal number."""
    size = abs(x)
    slab, _, null, _ = _densities(size, a)
    weight = w * slab / (w * slab + (1.0 - w) * null) if w > 0.0 else 0.0
    if uniform >= weight:
        return 0.0
    uniform = uniform / weight
    return math.copysign(1.0, x) * (
        _cauchy_draw(size, uniform, normal) if math.isnan(a) else _laplace_draw(size, a, uniform)
    )


@_jit
def threshold_value(w: float, a: float, bayes_factor: bool) -> float:
    """Threshold of a prior weight: infinite for 0, zero for 1."""
    if w == 0.0 or w == 1.0:
        return math.inf if w == 0.0 else 0.0
    low, high = 0.0, 45.0 + (0.0 if math.isnan(a) else a)
    for _ in range(100):
        middle = 0.5 * (low + high)
        slab, odds, null, _ = _densities(middle, a)
        # the median leaves 0 where w odds = 1 - w, P(mean = 0 | x) is 1/2 where w slab = (1 - w) null
        if w * (slab if bayes_factor else odds) > (1.0 - w) * null:
            high = middle
        else:
            low = middle
    return low


@_jit
def _moments(x: np.ndarray, n_cells: int) -> np.ndarray:
    """Sums of the Chebyshev polynomials over the sizes in each cell, shape (n_cells, _POINTS)."""
    sums = np.zeros((n_cells, _POINTS))
    for size in x:
        if size < _FAR:
            cell = int(size / _WIDTH)
            t = 2.0 * (size / _WIDTH - cell) - 1.0
        else:
            cell = int(math.log(size / _FAR) / math.log(_RATIO))
            t = 2.0 * (size / (_FAR * _RATIO**cell) - 1.0) / (_RATIO - 1.0) - 1.0
            cell += _NEAR
        value, following = 1.0, t
        for k in range(_POINTS):
            sums[cell, k] += value
            value, following = following, 2.0 * t * following - value
    return sums


def condensed(x: np.ndarray) -> np.ndarray:
    """Sizes and their counts, shape (2, n), with the sums over ``x`` of the densities' logarithms, to 1e-12.

    Interpolation in each cell makes :data:`_POINTS` sizes of all in it; where these are not fewer, ``x`` and ones.
    """
    n_cells = _NEAR + 2 + int(math.log(max(float(x.max()), _FAR) / _FAR) / math.log(_RATIO))
    sums = _moments(x, n_cells)
    (cells,) = np.nonzero(sums[:, 0])
    if _POINTS * cells.size >= x.size:
        return np.array([x, np.ones(x.size)])
    low = np.where(cells < _NEAR, _WIDTH * cells, _FAR * _RATIO ** (cells - _NEAR))
    width = np.where(cells < _NEAR, _WIDTH, (_RATIO - 1.0) * low)
    sizes = low[:, None] + 0.5 * width[:, None] * (1.0 + np.cos(_ANGLES))
    return np.array([sizes.ravel(), (sums[cells] @ _TO_COUNTS).ravel()])


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc"})
def _score(ratio: np.ndarray, counts: np.ndarray, w: float) -> tuple[float, float]:
    """Derivative of the log likelihood by w, and its own derivative."""
    first = second = 0.0
    for i in range(ratio.size):
        value = (1.0 - ratio[i]) / (w + (1.0 - w) * ratio[i])
        first += counts[i] * value
        second -= counts[i] * value * value
    return first, second


@_jit
def _best_weight(ratio: np.ndarray, counts: np.ndarray, low: float, w: float) -> float:
    """Weight in [low, 1] of maximum likelihood by Newton steps in 1/w; ``ratio`` is null over slab density."""
    if _score(ratio, counts, 1.0)[0] >= 0.0:
        return 1.0
    if _score(ratio, counts, low)[0] <= 0.0:
        return low
    high = 1.0
    w = min(max(w, low), high)
    for _ in range(200):
        first, second = _score(ratio, counts, w)
        if first > 0.0:
            low = w
        else:
            high = w
        new = w / (1.0 + first / (w * second))
        if not low < new < high:
            new = math.sqrt(low * high) if low > 0.0 else 0.01 * high
        if abs(new - w) <= 1e-11 * w:
            return new
        w = new
    return w


@_jit
def _laplace_ratios(points: np.ndarray, a: float, work: np.ndarray) -> float:
    """Fill work with null over slab density, d log(slab)/da and exp(-s) slab; return the sum of s."""
    x, counts = points
    ratio, slope, slab = work
    for i in range(x.size):
        ratio[i] = _mills(abs(x[i] - a))
        slope[i] = _mills(x[i] + a)
    total = 0.0
    for i in range(x.size):
        z = x[i] - a
        plus, minus, null, s = _laplace_sides(z, ratio[i], slope[i])
        slab[i] = 0.5 * a * (plus + minus)
        ratio[i] = null / slab[i]
        slope[i] = 1.0 / a - (2.0 * null + z * plus - (x[i] + a) * minus) / (plus + minus)
        total += counts[i] * s
    return total


@_jit
def profile(points: np.ndarray, a: float, bound: float, start: float, work: np.ndarray) -> tuple[float, float, float]:
    """Best weight under Laplace scale a, its log likelihood, and the derivative of that by log a (envelope theorem).

    ``points``: sizes and counts of :func:`condensed`; ``work``: room for three numbers of each.
    """
    low, low_slope = 0.0, 0.0
    if bound < math.inf:
        z, far = bound - a, _mills(bound + a)
        plus, minus, null, _ = _laplace_sides(z, _mills(abs(z)), far)
        odds = 0.5 * a * (plus - minus)
        low = null / (null + odds)
        low_slope = -low * low * (odds / a - 0.5 * a * (z * plus + (bound + a) * minus)) / null
    log_likelihood, counts = _laplace_ratios(points, a, work), points[1]
    ratio, slope, slab = work
    w = _best_weight(ratio, counts, low, start)
    derivative = _score(ratio, counts, w)[0] * low_slope if w == low else 0.0
    for i in range(counts.size):
        mixture = w + (1.0 - w) * ratio[i]
        log_likelihood += counts[i] * math.log(slab[i] * mixture)
        derivative += counts[i] * w * slope[i] / mixture
    return (w, log_likelihood, a * derivative) if w > 0.0 else (w, 0.0, 0.0)


@_jit
def _peak(
    points: np.ndarray,
    low: tuple[float, float, float, float],
    high: tuple[float, float, float, float],
    bound: float,
    work: np.ndarray,
) -> tuple[float, float, float, float]:
    """Local maximum between two points (log a, weight, log likelihood, slope), by the Illinois method."""
    (left, w, _, left_slope), (right, _, _, right_slope) = low, high
    best = low if low[2] > high[2] else high
    before = 0.0
    for _ in range(60):
        middle = (left * right_slope - right * left_slope) / (right_slope - left_slope)
        w, top, slope = profile(points, math.exp(middle), bound, w, work)
        moved = abs(middle - best[0])
        best = (middle, w, top, slope)
        if slope == 0.0 or moved < 1e-5:
            break
        if slope > 0.0:
            left, left_slope = middle, slope
            right_slope *= 0.5 if before > 0.0 else 1.0
        else:
            right, right_slope = middle, slope
            left_slope *= 0.5 if before < 0.0 else 1.0
        before = slope
    return best


@_jit
def fit_laplace(points: np.ndarray, bound: float) -> tuple[float, float, float]:
    """Weight, scale and log likelihood at the best local maximum of the profile over log a."""
    work = np.empty((3, points.shape[1]))
    best = last = (0.0, 0.0, -math.inf, 0.0)
    for k in range(_GRID.size):
        w, top, slope = profile(points, math.exp(_GRID[k]), bound, 0.5 if k == 0 else last[1], work)
        point = (_GRID[k], w, top, slope)
        if top >= best[2]:
            best = point
        if k > 0 and last[3] > 0.0 > slope:
            peak = _peak(points, last, point, bound, work)
            if peak[2] >= best[2]:
                best = peak
        last = point
    return best[1], min(max(math.exp(best[0]), SCALE_BOX[0]), SCALE_BOX[1]), best[2]


@_jit
def fit_cauchy(points: np.ndarray, bound: float) -> tuple[float, float, float]:
    """Weight, nan and log likelihood."""
    x, counts = points
    ratio, slab, log_likelihood = np.empty(x.size), np.empty(x.size), 0.0
    for i in range(x.size):
        slab[i], _, null, s = _densities(x[i], math.nan)
        ratio[i] = null / slab[i]
        log_likelihood += counts[i] * s
    low = 0.0
    if bound < math.inf:
        _, odds, null, _ = _densities(bound, math.nan)
        low = null / (null + odds)
    w = _best_weight(ratio, counts, low, 0.5)
    for i in range(x.size):
        log_likelihood += counts[i] * math.log(slab[i] * (w + (1.0 - w) * ratio[i]))
    return w, math.nan, log_likelihood if w > 0.0 else 0.0
