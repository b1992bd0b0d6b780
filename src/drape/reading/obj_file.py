"""OBJ: polygons in the order of the file, texture coordinates, materials. (trimesh would cut them up and reorder.)"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from drape.reading.mesh_record import MeshFile, Polygons


def read_obj(path: Path) -> MeshFile:
    """Vertices and faces of all objects (``o``) and groups (``g``); normals, lines, points and curves are not read.

    Raises:
        ValueError: a line that cannot be read; it is quoted.
    """
    text = path.read_text(encoding="utf-8-sig", errors="replace").replace("\\\n", " ").replace("\\\r\n", " ")
    vertices, textures, corners, textured, sizes, material = [], [], [], [], [], []
    names, objects = dict[str, int](), dict[tuple[str, ...], int]()
    current, owner, within = -1, [], {"o": list[str](), "g": list[str]()}
    for number, line in enumerate(text.splitlines(), 1):
        words = line.partition("#")[0].split()
        try:
            if words[:1] == ["v"]:
                vertices.append([float(word) for word in words[1:4]])
            elif words[:1] == ["vt"]:
                textures.append([float(word) for word in (*words[1:3], "0")[:2]])
            elif words[:1] == ["usemtl"]:
                current = names.setdefault(" ".join(words[1:]), len(names))
            elif words[:1] in (["o"], ["g"]):
                within[words[0]] = [" ".join(words[1:])] if words[0] == "o" else words[:0:-1]  # its own group first
            elif words[:1] == ["f"]:
                parts = [word.split("/") for word in words[1:]]
                corners += [_place(part[0], len(vertices)) for part in parts]
                textured += [_place(part[1], len(textures)) if part[1:] and part[1] else -1 for part in parts]
                sizes.append(len(parts))
                material.append(current)
                owner.append(objects.setdefault((*within["o"], *within["g"]), len(objects)))
        except ValueError as error:
            raise ValueError(f"line {number}, {line.strip()[:60]!r}: {error}") from error
    if any(len(vertex) != 3 for vertex in vertices):
        raise ValueError("a vertex without three coordinates")
    polygons = Polygons(np.array(corners, np.int64), np.array(sizes, np.int64))
    known = np.where(np.array(textured, np.int64) < len(textures), textured, -1)  # -1: the last row, NaN
    uv = np.array([*textures, [np.nan, np.nan]])[known] if (known >= 0).any() else None
    return MeshFile(
        path,
        polygons,
        np.array(vertices, np.float64).reshape(1, -1, 3),
        uv=uv,
        materials=tuple(names),
        material=np.array(material, np.int64) if names else None,
        objects=tuple(objects),
        object=np.array(owner, np.int64),
    )


def _place(word: str, count: int) -> int:
    """From 0 on; the file counts from 1, or backwards from -1."""
    number = int(word)
    place = number - 1 if number > 0 else count + number
    if number == 0 or place < 0:
        raise ValueError(f"found index {number}; expected 1 to {count}")
    return place
