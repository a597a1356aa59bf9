"""One shake on one core: contact points, engine, integrator, and the rules that end it."""
