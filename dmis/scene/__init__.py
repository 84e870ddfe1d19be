"""A scene: camera, parts, lights, its plan, and shading points."""
