"""From Python functions to machine code: vector lanes, pieces, and where their code is kept."""
