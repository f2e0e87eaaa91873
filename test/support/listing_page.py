"""Type the changes of docs/exact.md into its listing, as the page says."""

import ast
import re
import textwrap

from support.paths import CHECKOUT


def code_blocks(text):
    """Return the indented blocks of a text that are Python."""
    blocks = re.findall(r"(?:^ {4}.*\n|^\n(?= {4}))+", text, re.MULTILINE)
    return [
        each for each in (textwrap.dedent(block).strip("\n") for block in blocks) if parse(each)
    ]


def parse(block):
    """Return the statements of a block; its first line if it is only that of a program."""
    try:
        return ast.parse(block).body or (block.startswith("#!") and [block])
    except SyntaxError:
        return []


class Program:
    """A program that is typed block by block."""

    def __init__(self):
        self._first_line = ""
        self._main = ""
        # By what their parts define: a module, a constant, a function.
        self._imports, self._constants, self._functions = {}, {}, {}

    def type(self, block):
        """Replace what a block defines, and add what is new."""
        if block.startswith("#!"):
            self._first_line = block.split("\n")[0]
        for part in ast.parse(block).body:
            text = "\n".join(block.split("\n")[part.lineno - 1 : part.end_lineno])
            if isinstance(part, ast.FunctionDef):
                self._functions[part.name] = text
            elif isinstance(part, ast.If):
                self._main = text
            elif isinstance(part, ast.Assign):
                self._assign(part.targets[0].id, text)
            else:
                self._imports[getattr(part, "module", part.names[0].name)] = text

    def _assign(self, name, text):
        old = re.findall(rf"^ {{4}}{name} = .*", self._main, re.MULTILINE)
        if old:
            self._main = self._main.replace(*old, f"    {text}")
        else:
            self._constants[name] = text

    @property
    def text(self):
        parts = (self._imports, self._constants, self._functions)
        typed = [text for part in parts for text in part.values()]
        return "\n".join([self._first_line, *typed, self._main, ""])


def states():
    """Return the program after each numbered section of the page, by the heading."""
    with open(f"{CHECKOUT}/docs/exact.md", encoding="utf-8") as file:
        sections = re.split(r"^## (.*)\n", file.read(), flags=re.MULTILINE)
    program, found = Program(), {}
    for heading, text in zip(sections[1::2], sections[2::2]):
        for block in code_blocks(text):
            program.type(block)
        if heading[0].isdigit():
            found[heading] = program.text
    return found
