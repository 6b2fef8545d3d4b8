"""Check the words of the pages and docstrings: sentence length, idiom, names of functions.

python scripts/check_words.py [FILE, DIRECTORY or PATTERN ...]

Checks the pages and Python files that git finds below the arguments (by default all of them),
except tests and the changelog. Prints one line a fault (`file:line: message`) and exits 1 on any.
"""

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

from markdown_it import MarkdownIt
from markdown_it.token import Token

MOST_WORDS = 25
MOST_PAGE_WORDS = 2500

REPORTING = (
    r"(so|which|that|why|what|whether|how|where|when|by|in|with|before|for|of|it|nothing|no)"
)

PATTERNS = {
    r"\bgo(es|ing)? on\b(?! (the|a|an|to|top|disk)\b)": 'write "resume" or "continue"',
    r"\banew\b": 'write "again" or "from scratch"',
    r"(^|[,;:] )who(ever|m)? \w+": 'name the subject instead of "who ..."',
    r"\blacks?[.,;:)]": '"is missing", or name what lacks what',
    rf"\b(says?|said|tells?|told) {REPORTING}\b": 'write "reports", "states" or "prints"',
    r"\bstands (for itself|in the(?! way)|as)\b": 'write "is" or "applies"',
    r"\b(used to|formerly) (?!be used|find|make|build|draw|measure|choose)": (
        "history belongs in the changelog"
    ),
    r"\bwhere (no|nothing|it is not|there is no|one) ": 'write "if"',
    r"\bis all one\b|\bby heart\b|\bas ever\b|\bputs? right\b": (
        "an idiom that readers stumble over"
    ),
}

PARTICIPLES = {
    *(
        "sent",
        "withdrawn",
        "freed",
        "said",
        "told",
        "asked",
        "kept",
        "gone",
        "say",
        "doing",
        "lost",
        "noted",
        "stopped",
    ),
    *(
        "staged",
        "leased",
        "mirrored",
        "fetched",
        "remembered",
        "reopened",
        "hosted",
        "started",
        "made",
        "seen",
        "checked",
        "judged",
    ),
}
"""Names that no function may have, with or without an underscore: a function is a verb, and prints
or reports instead of saying."""


def text_of(token: Token) -> str:
    """The running text of an inline token; code becomes one word, link and emphasis marks go."""
    words = {"softbreak": " ", "hardbreak": " ", "code_inline": "CODE"}
    return "".join(
        child.content if child.type == "text" else words.get(child.type, "")
        for child in token.children or []
    )


def passages(markdown: str) -> Iterator[tuple[int, str, bool]]:
    """(line, text, whether it is a cell of a table) of a page without its code blocks; running text
    by sentences."""
    depth = 0
    for token in MarkdownIt("commonmark").enable("table").parse(markdown):
        depth += {"table_open": 1, "table_close": -1}.get(token.type, 0)
        if token.type == "inline" and token.map is not None:
            parts = (
                [text_of(token)]
                if depth
                else re.split(r"(?<=[.!?])\s+(?=[A-Z`*\"(\[])", text_of(token))
            )
            yield from ((token.map[0] + 1, part.strip(), depth > 0) for part in parts)


def judge(sentence: str) -> Iterator[str]:
    """What is wrong with one sentence. A list after a colon counts apart."""
    longest = max(len(re.findall(r"\S*\w\S*", part)) for part in re.split(r":\s", sentence))
    if longest > MOST_WORDS:
        yield f"{longest} words in a sentence (at most {MOST_WORDS}): {sentence[:70]}..."
    yield from idioms(sentence)


def idioms(sentence: str) -> Iterator[str]:
    """The phrases of a text that readers stumble over."""
    for pattern, advice in PATTERNS.items():
        if found := re.search(pattern, sentence, re.IGNORECASE):
            yield f'"{found[0]}": {advice}: {sentence[:90]}'


def check_page(path: Path) -> Iterator[tuple[int, str]]:
    """What is wrong with the sentences and cells of a page, and with its length. Cells may be
    long."""
    words = 0
    for line, text, is_cell in passages(path.read_text()):
        yield from ((line, message) for message in (idioms if is_cell else judge)(text))
        words += 0 if is_cell else len(text.split())
    if words > MOST_PAGE_WORDS:
        yield 1, f"{words} words of text (at most {MOST_PAGE_WORDS})"


def check_module(path: Path) -> Iterator[tuple[int, str]]:
    """What is wrong with the first sentences of the docstrings and with the names of the functions
    of a Python file."""
    functions, tree = ast.FunctionDef | ast.AsyncFunctionDef, ast.parse(path.read_text())
    for owner in [tree, *(node for node in ast.walk(tree) if isinstance(node, ast.ClassDef))]:
        for node in owner.body:
            is_property = isinstance(node, functions) and any(
                "property" in ast.unparse(each) for each in node.decorator_list
            )
            if (
                isinstance(node, functions)
                and not is_property
                and node.name.strip("_") in PARTICIPLES
            ):
                yield node.lineno, f"function {node.name!r}: a function is a verb"
    for node in ast.walk(tree):
        if isinstance(node, functions | ast.ClassDef | ast.Module) and (
            text := ast.get_docstring(node)
        ):
            first = re.split(r"(?<=[.!?])\s", text.split("\n\n")[0].replace("\n", " "))[0]
            yield from ((getattr(node, "lineno", 1), message) for message in judge(first))


def found(patterns: list[str]) -> list[str]:
    """Pages and Python files that git tracks or could track below these paths, except tests, the
    changelog and deleted files."""
    command = [
        "git",
        "ls-files",
        "--cached",
        "--others",
        "--exclude-standard",
        "--deduplicate",
        "--",
        *patterns,
    ]
    names = subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()
    kept = [
        name
        for name in names
        if name.endswith((".md", ".py"))
        and not name.startswith("tests/")
        and name != "CHANGELOG.md"
    ]
    return [name for name in kept if Path(name).is_file()]


def main(names: list[str]) -> int:
    """Check the files; the number of faults found."""
    faults = [
        f"{name}:{line}: {message}"
        for name in found(names)
        for line, message in (check_page if name.endswith(".md") else check_module)(Path(name))
    ]
    print("\n".join(faults) or "words: no faults")
    return len(faults)


if __name__ == "__main__":
    sys.exit(1 if main(sys.argv[1:]) else 0)
