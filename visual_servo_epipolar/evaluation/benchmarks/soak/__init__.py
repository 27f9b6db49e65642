"""Run after run for a long time, through processes of nodes: what grows, and what comes late."""
