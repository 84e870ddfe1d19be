"""The format OBJ, with materials of MTL files."""
