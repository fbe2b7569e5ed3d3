"""Access control of the page: by a token in its address, or by host, and by origin."""

import hmac
import ipaddress
from urllib.parse import SplitResult, urlsplit

from aiohttp import web
from aiohttp.typedefs import Handler, Middleware


def is_loopback(host: str) -> bool:
    """Return whether a host name or address is a loopback one, that of this machine."""
    try:
        return ipaddress.ip_address(host.strip('[]')).is_loopback
    except ValueError:
        return host == 'localhost'


def guard(token: str) -> Middleware:
    """
    Return a middleware that refuses unauthorised requests with status 403.

    With a token, the path has to begin with it. Without one, the host of the request must be a
    loopback one, or another site could point a name of its own here (DNS rebinding). An Origin,
    which every browser sends with a WebSocket, must be the page's own.
    """
    @web.middleware
    async def check(request: web.Request, handler: Handler) -> web.StreamResponse:
        # not every path begins with a slash: that of OPTIONS may be a lone asterisk
        given = request.path.partition('/')[2].partition('/')[0].encode('utf-8', 'surrogateescape')
        if token and not hmac.compare_digest(given, token.encode()):
            raise web.HTTPForbidden(
                text='The address lacks its token: open the one that vtrack select printed.\n')
        if not token and not is_loopback(_split(f'//{request.host}').hostname or ''):
            raise web.HTTPForbidden(text=f'{request.host!r} is not an address of this machine.\n')
        origin = request.headers.get('Origin')
        if origin is not None and _split(origin).netloc != request.host:
            raise web.HTTPForbidden(text=f'Requests from pages of {origin} are not allowed.\n')
        return await handler(request)
    return check


def _split(address: str) -> SplitResult:
    """Return the parts of an address from a request; all are empty where it isn't one."""
    try:
        return urlsplit(address)
    except ValueError:
        return urlsplit('')
