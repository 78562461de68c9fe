"""Credentials in addresses: kept out of everything that is shown, put in from where nobody else reads them."""

from __future__ import annotations

import os
import re
from pathlib import Path
from urllib.parse import quote, urlsplit

from motion_detect_ros.core.errors import MotionDetectError, SourceError
from motion_detect_ros.sources.address import camera_number, is_address

#: ``user:password`` of the address, or the whole address.
SECRET_VARIABLE = 'MOTION_DETECT_SOURCE_SECRET'
MASK = '***'
#: All up to the last @ of an address, as passwords hold @, / and blanks too; one slash, as pathlib leaves of two.
_USER_INFO = re.compile(r'(\b[A-Za-z][\w+.-]*:/{1,3})(?:(?!\w+://)[^\r\n])*@')
#: In the query, or in the path after / or _ as recorders of the XMEye kind have it.
_QUERY = re.compile(r'([?&;/_][\w-]*?(?:pass|pas|pwd|secret|token|key|auth)[A-Za-z-]*=)[^&;\s]+', re.IGNORECASE)


def masked(text: str) -> str:
    """The text with user, password and the like of every address in it replaced by stars."""
    return _QUERY.sub(rf'\g<1>{MASK}', _USER_INFO.sub(rf'\g<1>{MASK}@', text))


def holds_secret(value: object) -> bool:
    """Whether it is a text of which ``masked`` hides something."""
    return isinstance(value, str) and masked(value) != value


def reason_of(error: Exception) -> str:
    """What a user can do something with, without credentials: our own messages, others with the name of their class."""
    return masked(str(error) if isinstance(error, MotionDetectError) else f'{type(error).__name__}: {error}')


def with_secret(address: str, secret_file: str) -> str:
    """The address with the credentials of ``secret_file``, or of the environment where that is empty.

    They are one line, ``user:password`` as they are (not percent-encoded), or a whole address, which replaces this one.
    Those of the environment are for addresses only: it is that of every camera that is started there.
    Raises: SourceError for a file that cannot be read or holds no line, for credentials from it of what is no address,
    and where an address does not say clearly to which host they would go.
    """
    of_network = is_address(address) and camera_number(address) is None
    secret = _secret(secret_file) if secret_file or of_network else ''
    if not secret or '://' in secret:
        return secret or address
    if not of_network:
        raise SourceError(f'source: expected an address (rtsp://...) for the credentials, got {masked(address)}')
    scheme, _, rest = address.partition('://')
    authority = until_path(rest)
    host = authority.rpartition('@')[2]
    if not _is_host(host):
        raise SourceError(f'source: expected HOST or HOST:PORT after ://, got {masked(address)}; '
                          'a / in a password is written %2F, a ? %3F, a # %23')
    user, _, password = secret.partition(':')
    return f'{scheme}://{quote(user, safe="")}:{quote(password, safe="")}@{host}{rest[len(authority):]}'


def until_path(rest: str) -> str:
    """What is before path, query and fragment of an address without its scheme: an @ in these is no user's."""
    return re.split('[/?#]', rest, maxsplit=1)[0]


def _is_host(host: str) -> bool:
    try:
        parts = urlsplit(f'//{host}')
        return bool(parts.hostname) and parts.port != 0
    except ValueError:  # a port that is no number or too large, half an IPv6 address
        return False


def _secret(secret_file: str) -> str:
    if not secret_file:
        return os.environ.get(SECRET_VARIABLE, '').strip()
    try:
        secret = Path(secret_file).read_text(encoding='utf-8').strip()
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else 'no text'
        raise SourceError(f'source_secret_file {secret_file}: {reason}') from None
    if not secret or len(secret.splitlines()) > 1:
        raise SourceError(f'source_secret_file {secret_file}: expected one line, user:password or an address')
    return secret
