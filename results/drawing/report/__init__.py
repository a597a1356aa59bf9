"""One page about a run that a reviewer can read without the program and without a network, and attach to a paper."""
