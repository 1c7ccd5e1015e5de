"""Process control: what a process has before it opens a file (`beginning`), signals that end it
(`stopping`), processes that work for it and inherit how it says warnings (`children`), atomic file
output, and warnings as lines.
"""
