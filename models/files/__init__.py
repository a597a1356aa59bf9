"""Files: whole or not at all, with digests, under limits; here or in a store."""

__all__ = ["digest", "documents", "folder", "given", "guarded", "mesh_files", "schemas", "stores", "table"]
