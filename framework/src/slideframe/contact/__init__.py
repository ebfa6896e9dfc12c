"""What grid nodes know of the solid ground: how deep they lie in it and which way out is.

The answer is independent of any backend: a list of normals, found by column of nodes.
"""

from slideframe.contact.mesh import TriangleMesh
from slideframe.contact.nodes import ContactNodes, find_contact, terrain_contact

__all__ = ["ContactNodes", "TriangleMesh", "find_contact", "terrain_contact"]
