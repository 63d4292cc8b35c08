"""Pages, docstrings, comments and messages have none of the phrases that a specialist would not write."""

import ast
import io
import re
import tokenize

import pytest

from .conftest import README_FILES, ROOT

#: Phrases that stand for a noun which should be repeated, that personify code, or that no field uses.
PHRASES = (
    "that of", "those of", "the one", "of its own", "go on", "goes on", "as a part of",
    "described instead of written", "by its kernel", "is a memo", "foretold", "is no rival",
    "stands for its rest", "forgets all", "travel as", "what p remembers", "must be said", "relative to which",
    "from which on", "below this part", "as far as the run knows", "a spring of an angle", "do the same",
    "do so"
)  # fmt: skip
_PHRASE = re.compile(rf"\b(?:{'|'.join(PHRASES)})\b(?!-)", re.IGNORECASE)

#: The parts of the project; tests, samples of reports and the record of changes are not read.
PARTS = (
    "README.md", "CONTRIBUTING.md", "SECURITY.md", "STABILITY.md", "eig3", "eig3/effects", "kernels",
    "problems", "bench"
)  # fmt: skip


def prose(path):
    """Yield the line and the text of each paragraph of a page, and of each comment and string of a Python file."""
    text = path.read_text()
    if path.suffix == ".md":
        yield 1, text
        return
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.lineno, node.value
    comments = [
        token for token in tokenize.generate_tokens(io.StringIO(text).readline) if token.type == tokenize.COMMENT
    ]
    block, last = [], None
    for token in comments:
        if last is not None and (token.start[0] > last.start[0] + 1 or token.start[1] != last.start[1]):
            yield last.start[0], " ".join(block)
            block = []
        block.append(token.string.lstrip("#: "))
        last = token
    if block:
        yield last.start[0], " ".join(block)


def files(part):
    """Return the pages and Python files of a part; eig3 has its effects in another part."""
    if part.endswith(".md"):
        return [ROOT / part]
    pages = [ROOT / name for name in README_FILES if name.startswith(f"{part}/")]
    found = [*pages, *sorted((ROOT / part).rglob("*.py"))]
    return [path for path in found if part != "eig3" or ROOT / "eig3/effects" not in path.parents]


def found_in(path):
    """Return "file:line: phrase" for each phrase in a file."""
    name = path.relative_to(ROOT)
    for line, text in prose(path):
        joined = re.sub(r"\s+", " ", text)
        for match in _PHRASE.finditer(joined):
            yield f"{name}:{line}: {joined[max(match.start() - 50, 0) : match.end() + 40]}"


@pytest.mark.parametrize("part", PARTS)
def test_no_phrase_that_a_specialist_would_not_write(part):
    assert [place for path in files(part) for place in found_in(path)] == []


def test_a_phrase_is_found_over_the_end_of_a_line(tmp_path, monkeypatch):
    """In a comment, a docstring and the constant parts of an f-string, but not in a name or another word."""
    monkeypatch.setattr("tests.test_words.ROOT", tmp_path)
    lines = [
        '"""The mass and that',
        '    of the spring."""',
        "# it goes",
        "# on",
        'error = f"{1} do so"',
        'that_of = "the one-sided density"',
    ]
    (tmp_path / "code.py").write_text("\n".join(lines) + "\n")
    assert [place.split(": ")[0] for place in found_in(tmp_path / "code.py")] == ["code.py:1", "code.py:5", "code.py:4"]
