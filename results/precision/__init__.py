"""A statement of stated precision from few jobs: the curve, what is asked of it, and which jobs tell most of it."""

STATEMENT_FILE = "statement.json"
"""Of a run: what it states, written anew after every round."""

MEASURES = ("pga_m_s2", "pgv_m_s", "pgd_m", "sa_1s_m_s2", "sa_2s_m_s2", "arias_m_s", "cav_m_s")
"""Measures of the horizontal shaking that grow with its scale, so that a level is a choice of them."""
