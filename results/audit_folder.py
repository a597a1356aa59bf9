"""Where the audits of a run lie: read without statistics, as by the status of a run."""

AUDIT_FOLDER = "audit"
"""In a run's folder; each engine that did jobs again has a folder of its own there, laid out as a run's results."""

DRAWN_FILE = "drawn.json"
"""In each of these: from which jobs the sample was drawn."""

REFERENCE = "reference"
"""Name of the audit by the same engine's finest preset."""

LEAST_JOBS = 10
"""Of fewer no statement is made."""
