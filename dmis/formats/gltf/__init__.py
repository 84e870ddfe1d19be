"""The format glTF, ``.glb`` and ``.gltf``."""
