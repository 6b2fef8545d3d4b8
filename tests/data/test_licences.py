"""Which licences a provenance names, and which forbid publishing."""

from pipeline.data.dataset import forbidden, licences_in


def test_licences_are_found_in_what_a_dataset_was_merged_and_drawn_from():
    made = {
        "licences": {"piper": "Apache-2.0"},
        "drawn_from": {"sources": [{"licences": {"mug7": "Proprietary"}}, {"x": 1}]},
    }
    assert licences_in(made) == {"mug7": "Proprietary", "piper": "Apache-2.0"}
    assert forbidden(licences_in(made)) == ["mug7 (Proprietary)"]


def test_free_and_unknown_licences_do_not_forbid():
    free = {
        str(i): text
        for i, text in enumerate(
            ("Apache-2.0", "CC-BY-4.0", "MIT", "unknown", "CC-BY-NC-4.0", "BSD-3-Clause")
        )
    }
    assert forbidden(free) == []
    assert (
        len(forbidden({"a": "CC-BY-ND-4.0", "b": "no redistribution", "c": "All rights reserved"}))
        == 3
    )
