"""A builder of small glTF files."""

import base64
import io
import json

import numpy as np
from helpers import glb
from PIL import Image as PIL

import dmis

CORNERS = np.array([[0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0]], np.float32)
FACES = np.array([0, 1, 2, 0, 2, 3])
UV = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], np.float32)  # v from the top
TYPES = {"f4": 5126, "u4": 5125, "u2": 5123, "u1": 5121, "i2": 5122, "i1": 5120}
KINDS = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}


class File:
    """A glTF file that grows: arrays and images go into its buffer."""

    def __init__(self):
        self.json = {"asset": {"version": "2.0"}, "accessors": [], "bufferViews": [], "nodes": [], "meshes": []}
        self.json |= {"materials": [], "textures": [], "images": []}
        self.body = b""

    def view(self, data, **more):
        self.json["bufferViews"].append({"buffer": 0, "byteOffset": len(self.body), "byteLength": len(data), **more})
        self.body += data + b"\0" * (-len(data) % 4)
        return len(self.json["bufferViews"]) - 1

    def accessor(self, view, table, **more):
        columns = 1 if table.ndim == 1 else table.shape[1]
        about = {"bufferView": view, "componentType": TYPES[table.dtype.str[1:]], "count": len(table)}
        self.json["accessors"].append({**about, "type": KINDS[columns], **more})
        return len(self.json["accessors"]) - 1

    def array(self, table, **more):
        return self.accessor(self.view(table.tobytes()), table, **more)

    def mesh(self, material=None, corners=CORNERS, faces=FACES, uv=UV, node=None, **attributes):
        """Add a mesh of one primitive and its node."""
        names = {"POSITION": self.array(corners), **{k: self.array(v) for k, v in attributes.items()}}
        if uv is not None:
            names["TEXCOORD_0"] = self.array(uv)
        primitive = {"attributes": names}
        if faces is not None:
            primitive["indices"] = self.array(faces.astype(np.uint16))
        return self.primitives([primitive], material, node)

    def primitives(self, primitives, material=None, node=None):
        for primitive in primitives:
            if material is not None:
                primitive["material"] = len(self.json["materials"])
        if material is not None:
            self.json["materials"].append(material)
        self.json["meshes"].append({"primitives": primitives})
        self.json["nodes"].append({"mesh": len(self.json["meshes"]) - 1, **(node or {})})
        return self

    def texture(self, pixels, **more):
        data = io.BytesIO()
        PIL.fromarray(pixels).save(data, "PNG")
        self.json["images"].append({"bufferView": self.view(data.getvalue()), "mimeType": "image/png"})
        self.json["textures"].append({"source": len(self.json["images"]) - 1, **more})
        return len(self.json["textures"]) - 1

    def write(self, path):
        document = {key: value for key, value in self.json.items() if value != []}
        if path.suffix == ".gltf":
            uri = f"data:application/octet-stream;base64,{base64.b64encode(self.body).decode()}"
            path.write_text(json.dumps({"buffers": [{"byteLength": len(self.body), "uri": uri}], **document}))
            return path
        path.write_bytes(glb({"buffers": [{"byteLength": len(self.body)}], **document}, self.body))
        return path

    def load(self, tmp_path, name="a.glb", **options):
        return dmis.load_scene(self.write(tmp_path / name), **options)
