"""Comments of the header: nothing that users write breaks them."""

from __future__ import annotations

from rrrgen.emit.c.header_comments import explanation
from rrrgen.emit.c.language import Dialect
from rrrgen.emit.printing import plain
from rrrgen.program import Builder, Port

DIALECT = Dialect("t")


def test_comments_cannot_be_broken_by_what_users_write():
    port = Port("x", (1,), "m */ int evil;", "/* base", "a \\\n multi-line ??/ text \u202e\x07")
    b = Builder()
    program = b.program("f", [(Port("y", (1,)), b.input(port))], "Ends here: */ exit(1); /*")
    text = "\n".join(explanation(program, DIALECT))
    assert "*/" not in text
    assert "/*" not in text
    assert "??/" not in text
    assert plain("tab\tnewline\n back\\") == "tab newline back"
    assert "\u202e" not in text
