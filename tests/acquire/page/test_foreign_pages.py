"""Pages from the web in a real browser, which know the address and even the token."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from typing import TYPE_CHECKING, Any

import pytest

from tests.acquire.browsers import ARGUMENTS, NO_GRAPHICS
from tests.acquire.page.pages import Served, served

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Playwright

pytestmark = pytest.mark.browser
REBOUND = "rebound.example"

# Whatever a page may try; what became of each.
ATTACK = """async (address) => {
  const found = {};
  const late = () => new Promise((end) => setTimeout(end, 3000, "nothing"));
  const within = (promise) => Promise.race([promise, late()]);
  const load = (tag, attribute, url) => within(new Promise((end) => {
    const made = document.createElement(tag);
    made.onload = () => end("loaded");
    made.onerror = () => end("refused");
    made[attribute] = url;
    document.body.append(made);
  }));
  const answer = async (url, how) => {
    try {
      const got = await fetch(url, how);
      return `${got.type} ${got.status} ${(await got.text()).includes("lumisplit")}`;
    } catch { return "refused"; }
  };
  found.socket = await within(new Promise((end) => {
    const socket = new WebSocket(address.replace("http", "ws") + "socket");
    socket.onopen = () => { socket.send('{"do": "show", "what": "white"}'); end("open"); };
    socket.onerror = () => end("refused");
  }));
  found.read = await answer(address);
  found.opaque = await answer(address, { mode: "no-cors" });
  found.post = await answer(address, { method: "POST", mode: "no-cors", body: '{"do": "start"}' });
  found.script = await load("script", "src", address + "page.js");
  found.image = await load("img", "src", address + "icon.svg");
  const frame = document.createElement("iframe");
  frame.src = address;
  document.body.append(frame);
  await new Promise((end) => { frame.onload = end; setTimeout(end, 3000); });
  try { found.frame = frame.contentDocument?.body.innerHTML ?? "opaque"; }
  catch { found.frame = "opaque"; }
  found.frames = frame.contentWindow.length;
  return found;
}"""


@pytest.fixture(scope="module")
def page() -> Iterator[Served]:
    with served() as page:
        yield page


class Silent(SimpleHTTPRequestHandler):
    def log_message(self, *_: Any) -> None:
        pass


@pytest.fixture(scope="module")
def foreign(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Another server on this computer; every name leads to it."""
    folder = tmp_path_factory.mktemp("foreign")
    (folder / "index.html").write_text("<!doctype html><title>harmless</title><body></body>")
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(Silent, directory=str(folder)))
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    yield f":{server.server_port}/"
    server.shutdown()
    thread.join()
    server.server_close()


@pytest.fixture(scope="module")
def browser(playwright: Playwright, chromium: str) -> Iterator[Browser]:
    names = f"--host-resolver-rules=MAP {REBOUND} 127.0.0.1, MAP evil.example 127.0.0.1"
    browser = playwright.chromium.launch(
        executable_path=chromium, args=[*ARGUMENTS, *NO_GRAPHICS, names]
    )
    yield browser
    browser.close()


@pytest.mark.parametrize("host", ["evil.example", "127.0.0.1", "localhost"])
def test_a_foreign_page_reaches_nothing(
    page: Served, foreign: str, browser: Browser, host: str
) -> None:
    tab = browser.new_page()
    tab.goto(f"http://{host}{foreign}")
    assert tab.title() == "harmless"
    found = tab.evaluate(ATTACK, page.link.address)
    tab.close()
    assert found["socket"] == "refused"
    assert found["read"] == "refused"
    assert found["opaque"] in {"refused", "opaque 0 false"}
    assert found["post"] in {"refused", "opaque 0 false"}
    assert found["script"] == "refused"
    assert found["image"] == "refused"
    assert found["frame"] == "opaque"
    assert found["frames"] == 0
    with pytest.raises(queue.Empty):
        page.commands.get(timeout=0.05)


def test_a_rebound_name_gets_nothing(page: Served, browser: Browser) -> None:
    """The browser takes the page's own port for a site of the attacker."""
    tab = browser.new_page()
    answer = tab.goto(f"http://{REBOUND}:{page.port}/{page.token}/")
    assert answer is not None
    assert answer.status == 403
    tab.goto("about:blank")
    tab.close()


def test_an_opened_window_cannot_be_held(page: Served, foreign: str, browser: Browser) -> None:
    tab = browser.new_page()
    tab.goto(f"http://evil.example{foreign}")
    with tab.context.expect_page() as opening:
        tab.evaluate("(address) => { window.taken = window.open(address); }", page.link.address)
    opened = opening.value
    opened.wait_for_load_state()
    assert opened.evaluate("window.opener === null")
    deadline_s = time.monotonic() + 10
    while not tab.evaluate("window.taken.closed"):
        assert time.monotonic() < deadline_s
    assert opened.inner_text("body").strip() == "forbidden"
    opened.close()
    tab.close()


def test_the_address_is_told_to_nobody(page: Served, foreign: str, browser: Browser) -> None:
    """A link from the page leads away without its token."""
    tab = browser.new_page()
    tab.goto(page.link.address)
    with tab.expect_request(lambda request: foreign.strip("/") in request.url) as asked:
        tab.evaluate("(there) => { location.href = there; }", f"http://evil.example{foreign}")
    assert page.token not in str(asked.value.all_headers())
    tab.close()


def test_the_page_runs_no_script_but_its_own(page: Served, browser: Browser) -> None:
    tab = browser.new_page()
    tab.goto(page.link.address)
    ran = tab.evaluate("""() => {
      const made = document.createElement("script");
      made.textContent = "window.ran = true";
      document.body.append(made);
      const image = document.createElement("img");
      image.setAttribute("onerror", "window.ran = true");
      image.src = "nothing.png";
      document.body.append(image);
      return new Promise((end) => setTimeout(() => end(window.ran === true), 500));
    }""")
    assert ran is False
    tab.close()
