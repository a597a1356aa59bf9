"""From fragility to hazard: what a rock that still stands says about the ground motion that has not happened.

With an annual rate of exceedance lambda(x), toppling has the rate nu = integral of F(x) |d lambda(x)|, and
the rock survives T years with probability exp(-nu T) (Poisson events). Rocks that stand together feel the
same events: at least one topples with 1 - prod(1 - F_i(x)); taking them as independent would be biased.

A curve says nothing outside its points x_0 ... x_n. What it leaves out is not counted in nu, so nu is a least
rate and survival a greatest probability: a rejection stands, and a branch that is kept may hang on it. Two terms
are told beside the answer (`unstated_shares`):

- above x_n, at most (1 - F(x_n)) lambda(x_n): as if every event beyond it toppled a rock;
- below x_0, the integral of F(x) k lambda(x_0) (x / x_0)^-k dx / x from 0 to x_0: the first segment's power law,
  of exponent k, goes on. Hazard curves flatten toward small intensities, as there are only so many earthquakes
  a year, so this is rather too much; it is no bound for a curve that steepens there.
"""

__all__ = [
    "ages", "curves", "events", "export", "faults", "gmm", "magnitudes", "measure_names",
    "places", "survival", "tree", "update", "vector",
]  # fmt: skip
