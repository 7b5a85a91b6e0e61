"""What a page of an evaluation is made of, each part from rows to cells and figures."""
