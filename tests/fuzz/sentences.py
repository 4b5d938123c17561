"""What every refusal must be: words for a person."""

from __future__ import annotations

__all__ = ["refuse_unless_sentence"]


def refuse_unless_sentence(error: Exception, *words: str) -> None:
    """Fail unless an error is a sentence, of a length that can be read, that has these words."""
    text = str(error)
    assert all(word in text for word in words), text
    assert text.strip(), "an error says nothing"
    assert text.rstrip().endswith((".", ")", "…")), f"no end of a sentence: {text[-80:]!r}"
    assert len(text) < 4000, f"an error of {len(text)} characters: {text[:200]!r}"
