"""One integration: its checked arguments, its steps in chunks, why a step fails.

    parameters   the parameters of a run, in their domains
    consistency  whether states are on the constraints
    count        how many steps lead to a time
    integration  one integration, in chunks
    follow       a co-moving frame that is chosen anew, block by block
    newton       T1 driven from Python, open to inspection
    failure      why a step failed, and what would do
"""
