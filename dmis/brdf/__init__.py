"""Reflection: one file per model, Fresnel terms, distributions, textures, materials."""
