"""What compiled loops need: threads, tables of arrays, arrays on the stack, vectors."""
