"""What commands print."""

from pipeline.commands.common import print_result


def test_what_a_terminal_would_obey_is_shown_and_not_sent(capsys):
    hostile = "a\x1b[31mred\x1b]0;title\x07 b\r\nnext \u202eline"
    print_result({"name": hostile}, False, hostile)
    print_result({"name": hostile}, True, "")
    text = capsys.readouterr().out
    assert text.splitlines()[0] == r"a\x1b[31mred\x1b]0;title\x07 b\r" and all(
        c.isprintable() or c == "\n" for c in text
    )
