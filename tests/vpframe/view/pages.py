"""Pages that connect to a viewer."""

import asyncio
import json
import urllib.error
import urllib.parse
import urllib.request

import tornado.websocket


def of_type(kind):
    return lambda message: message["type"] == kind


def socket_of(viewer, **changed):
    """The address of the page's socket, with parts of it changed."""
    place = urllib.parse.urlsplit(viewer.url)
    return place._replace(scheme="ws", path="/socket")._replace(**changed).geturl()


def answer(address, **headers):
    """Status and body of what a server answers to an ordinary request."""
    try:
        got = urllib.request.urlopen(urllib.request.Request(address, headers=headers), timeout=5)
    except urllib.error.HTTPError as refused:
        got = refused
    return got.status, got.read()


def socket_answer(address, **headers):
    """The first message that a socket sends, or the status that refuses it."""

    async def look():
        request = tornado.websocket.httpclient.HTTPRequest(address, headers=headers)
        try:
            page = await tornado.websocket.websocket_connect(request)
        except tornado.httpclient.HTTPClientError as refused:
            return refused.code
        return json.loads(await asyncio.wait_for(page.read_message(), 10))["type"]

    return asyncio.run(look())


async def connect(viewer):
    return await tornado.websocket.websocket_connect(socket_of(viewer))


async def receive(page, wanted, answer=True, limit=10.0):
    """Messages up to the first for which `wanted` is true; each is answered as the page does."""
    got = []
    while True:
        text = await asyncio.wait_for(page.read_message(), limit)
        if text is None:
            return got
        got.append(json.loads(text))
        if answer:
            await page.write_message('{"action": "drawn"}')
        if wanted(got[-1]):
            return got
