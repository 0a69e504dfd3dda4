"""What each part is made of (Paper: Sec. 3.4): the library, the rule table, and who has the last word."""

from phys4dgen.materials.book import assemble_book, library_warnings, parse_choices
from phys4dgen.materials.library import KNOWN_LAWS, LibraryEntry, find_entry, library_entries, material
from phys4dgen.materials.materials_yaml import read_materials, write_materials
from phys4dgen.materials.rules import RULES, Rule, identify_by_rules

__all__ = [
    "KNOWN_LAWS",
    "RULES",
    "LibraryEntry",
    "Rule",
    "assemble_book",
    "find_entry",
    "identify_by_rules",
    "library_entries",
    "library_warnings",
    "material",
    "parse_choices",
    "read_materials",
    "write_materials",
]
