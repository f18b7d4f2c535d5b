"""Operations by the names that people know them by."""

from ....schemas.operations.registry import OPERATIONS


def operation_name(word: str) -> str:
    """The service's name of an operation, also from the AWS CLI's spelling: `describe-world`.

    A word that names none comes back as it is; the check of the request says what is near.
    """
    folded = word.replace("-", "").lower()
    return next((name for name in OPERATIONS if name.lower() == folded), word)
