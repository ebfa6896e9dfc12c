"""What grid nodes know of solid ground and bodies: how deep they lie in it and which way out is.

The answer is independent of any backend: a list of normals, found by column of nodes.
"""

from slideframe.contact.bodies import Body, bodies_of, require_at_site, require_sound_files
from slideframe.contact.ground import ground_contact
from slideframe.contact.mesh import TriangleMesh
from slideframe.contact.nodes import ContactNodes, merge, solid_nodes

__all__ = [
    "Body",
    "ContactNodes",
    "TriangleMesh",
    "bodies_of",
    "ground_contact",
    "merge",
    "require_at_site",
    "require_sound_files",
    "solid_nodes",
]
