"""The optimal control problem of a control step."""
