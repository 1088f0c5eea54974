"""Every digit, in stiff and extreme scenes: the cases, what is checked of each, and the table of what was found.

A covering array of the axes in `cases` and the named `corners` are solved and checked against stored answers of ball
arithmetic where there are any, and against the laws that every answer has to keep.
`python -m bench.stability` runs it all.
"""
