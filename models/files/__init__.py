"""Files: whole or not at all, with digests, under limits; here or in a store."""

__all__ = [
    "csv_text", "digest", "documents", "folder", "given", "guarded", "mesh_files", "ply", "run_document",
    "scene_document", "stores", "table", "tables", "text_file",
]  # fmt: skip
