"""Files: whole or not at all, with digests, under limits; here or in a store."""
