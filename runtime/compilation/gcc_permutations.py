"""Objects in which gcc may have permuted a vector of eight doubles wrongly.

gcc compiles a constant permutation x → (x[i_0], ..., x[i_7]) of a 512-bit vector of doubles to
``vpermilpd`` with an immediate, which moves within pairs, even if i_2 or i_3 are 4 to 7: its
``avx_vpermilp_parallel`` (i386.cc) bounds both from below alone. Lane 2 or 3 of the result is then
x[2] or x[3]. Four elements of eight, as in

    (v4){ x[1], x[1], x[2], x[6] }

are such a permutation for the optimiser (tree-ssa-forwprop.cc), and the vectoriser writes them
wherever straight code, an inlined kernel say, reads an array that a vectorised loop has filled. Of
1,700 permutations gcc 12.2 gets 650 wrong, all with this instruction and all by this rule. clang
does not.

So no wrong permutation is in an object without the instruction. The few objects with it, right or
wrong, are compiled again without the passes that make permutations.
"""

from __future__ import annotations

import re

__all__ = ["WITHOUT_PERMUTATIONS", "has_permutation"]

#: Flags to compile with instead, until no instruction is left: without joining elements to
#: permutations, which costs next to nothing; without vectorising, of which nothing is left to join.
#: Less is then known of variables, and gcc takes some for uninitialised that it did not before.
WITHOUT_PERMUTATIONS = (
    ["-fno-tree-forwprop", "-Wno-error"],
    ["-fno-tree-forwprop", "-Wno-error", "-fno-tree-vectorize", "-fno-tree-slp-vectorize"],
)

#: EVEX.512.66.0F3A.W1 05: prefix, map 3 with any registers, W1 and 66, 512 bits, opcode.
_VPERMILPD = re.compile(
    rb"\x62[\x03\x13\x23\x33\x43\x53\x63\x73\x83\x93\xa3\xb3\xc3\xd3\xe3\xf3]\xfd"
    rb"[\x40-\x5f\xc0-\xdf]\x05", re.DOTALL)


def has_permutation(machine_code: bytes) -> bool:
    """Return whether machine code for x86-64 has a 512-bit ``vpermilpd`` with an immediate."""
    return _VPERMILPD.search(machine_code) is not None
