"""MIS-Bench: pilot samples as tables, and a judge of weight rules that renders nothing."""
