"""Types of what this project uses of google-re2, which has none itself."""

class Options:
    log_errors: bool
    dot_nl: bool

class Expression:
    def fullmatch(self, text: str) -> object | None: ...

def compile(pattern: str, options: Options | None = None) -> Expression: ...  # noqa: A001 - the name it has there
