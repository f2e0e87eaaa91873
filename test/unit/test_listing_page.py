"""The program of docs/exact.md is complete after each change, and ends as examples/my_ros_intro.

test/system/test_listing.py lets each state drive.
"""

import ast
import builtins
import symtable

import pytest

from support.listing_page import states
from support.paths import CHECKOUT

STATES = states()
IN_EVERY_MODULE = {"__name__", *dir(builtins)}


def undefined(program):
    """Return the global names that a program uses, but does not define."""
    tables, used = [symtable.symtable(program, "program", "exec")], set()
    defined = {each.get_name() for each in tables[0].get_symbols() if each.is_assigned()}
    defined |= {each.get_name() for each in tables[0].get_symbols() if each.is_imported()}
    for table in tables:
        tables += table.get_children()
        used |= {each.get_name() for each in table.get_symbols() if each.is_global()}
    used |= {each.get_name() for each in tables[0].get_symbols() if each.is_referenced()}
    return used - defined - IN_EVERY_MODULE


@pytest.mark.parametrize("heading", STATES)
def test_each_change_is_complete(heading):
    assert undefined(STATES[heading]) == set()


def test_the_changes_are_numbered():
    assert [heading.split(". ")[0] for heading in STATES] == [*map(str, range(1, len(STATES) + 1))]


def parts_of(program):
    """Return the texts of the functions, the main part and the assignments, and the imports."""
    tree = ast.parse(program)
    imports = {
        ast.dump(each) for each in tree.body if isinstance(each, (ast.Import, ast.ImportFrom))
    }
    others = (ast.FunctionDef, ast.If, ast.Assign)
    return imports, sorted(
        ast.get_source_segment(program, each) for each in tree.body if isinstance(each, others)
    )


def test_the_last_state_is_the_example():
    with open(f"{CHECKOUT}/examples/my_ros_intro/src/path_publisher.py", encoding="utf-8") as file:
        example = file.read()
    last = [*STATES.values()][-1]
    assert last.split("\n")[0] == example.split("\n")[0]
    assert parts_of(last) == parts_of(example)
