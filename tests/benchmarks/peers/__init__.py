"""The work of this package beside what its peers need for the same work: speed, growth and memory.

From the folder ``tests``: ``python -m benchmarks.peers``. One file for each peer, with a function
for each job that it does: from the job's size to what is timed. What a peer leaves out, and why,
stands in `_tools`.
"""
