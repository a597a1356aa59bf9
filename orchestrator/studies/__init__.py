"""What is done with runs: audited, conditioned, ended by precision, repeated, scored. The core never imports it."""
