def table(lines, commit):
    return "todo"
