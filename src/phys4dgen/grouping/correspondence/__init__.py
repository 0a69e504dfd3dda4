"""Which segment of a user's picture is which part of the object (Paper: Sec. 3.4, fusion by CLIP)."""

from phys4dgen.grouping.correspondence.name_parts import NamedSegments, PartNaming, name_parts_by_picture
from phys4dgen.grouping.correspondence.segments_file import read_segments

__all__ = ["NamedSegments", "PartNaming", "name_parts_by_picture", "read_segments"]
