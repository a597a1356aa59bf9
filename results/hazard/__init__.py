"""From fragility to hazard: constraints by rocks that still stand on the ground motion that has not happened.

With an annual rate of exceedance lambda(x), toppling has the rate nu = integral of F(x) |d lambda(x)|, and
the rock survives T years with probability exp(-nu T) (Poisson events). Rocks of one site are shaken by the
same events: at least one topples with 1 - prod(1 - F_i(x)); taking them as independent would be biased.

A hazard curve is undefined outside its points x_0 ... x_n. What lies outside is not counted in nu, so nu is a lower
bound and survival an upper bound: a rejection is valid, but an accepted branch may depend on it. Two terms are
reported with the result (`unstated_fractions`):

- above x_n, at most (1 - F(x_n)) lambda(x_n): as if every event beyond it toppled a rock;
- below x_0, the integral of F(x) k lambda(x_0) (x / x_0)^-k dx / x from 0 to x_0: the first segment's power law,
  of exponent k, extrapolated. Hazard curves flatten toward small intensities, because the number of earthquakes a
  year is finite, so this overestimates; it is no bound for a curve that steepens there.
"""

__all__ = [
    "ages", "events", "gmm", "magnitudes", "measure_names", "places", "survival", "tree", "update",
]  # fmt: skip
