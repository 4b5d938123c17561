"""Reading text: the grammar of arithmetic, what its numbers are, the names C keeps for itself.

Text comes from files of unknown origin: it is read here, character by character and in bounded time
and memory, and is never handed to Python or to SymPy's parsers.

    tokens           the words of a text, and where in it a refusal belongs
    grammar          one parser for whatever numbers compute
    bounded_numbers  exact numbers whose every operation is bounded
    expressions      arithmetic text as an exact number, such as an entry of a tableau
    c_names          names that C keeps for itself
    text_file        a file as text, or a refusal
"""
