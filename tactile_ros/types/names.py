"""Names and labels that come from outside: what they may be made of."""

from __future__ import annotations

import re

MOST_CHARACTERS = 100
# letters and digits of any script, and what names of frames, units and objects are written with
NAME = re.compile(r'[\w .,:/()\[\]+*%^=#°~-]*')


def admit_name(what: str, name: str) -> str:
    """Refuse a name that could be markup, a command or an end of line; return it otherwise.

    Parameters
    ----------
    what : str
        Whose name, for the sentence.
    name : str
        May be empty.

    Returns
    -------
    str
        The same.

    Raises
    ------
    ValueError
        If it is longer than 100 characters or has others than letters, digits, spaces and
        `. , : / ( ) [ ] + * % ^ = # _ ~ -`.

    Examples
    --------
    >>> admit_name('frame_id of Layout', 'thumb/tip')
    'thumb/tip'
    """
    if len(name) > MOST_CHARACTERS or not NAME.fullmatch(name):
        msg = (
            f'{what} must be at most {MOST_CHARACTERS} letters, digits, spaces and '
            f'.,:/()[]+*%^=#_~-; received {name[:40]!r}'
        )
        raise ValueError(msg)
    return name
