"""What is done to the page by files and by other sites, in a real browser and at the socket."""

from __future__ import annotations

import contextlib
import http.client
import json
import socket
import statistics
import sys
import time
from functools import partial
from pathlib import Path
from urllib.parse import urlsplit

import h5py
import pytest
from tests.support.sample_results import table2
from tests.support.serving import VIBRIDENT, WAIT_MS, serving, start_anew, upload

from vibrident.app.workflow.accounts import add_account

TAG = "<img src=x onerror=window.pwned=1>"
LINK = '<a href="https://evil.example/">u</a>'
ANSWER_S = 120.0  # longest wait for an answer, on a busy machine
#: Bytes of memory that the server may ever have held: it has the libraries, and no file.
MOST_MEMORY = 600_000_000


def peak_memory(pid: int) -> int:
    status = Path(f"/proc/{pid}/status").read_text()
    return int(status.partition("VmHWM:")[2].split()[0]) * 1024


def test_text_of_others_stays_text(visit, picture, tmp_path):
    """File and column names, a calibration file, the sensor, and a result of unknown origin."""
    rows = "".join(f"{i / 1000},{i % 7},{i % 5}\n" for i in range(60))
    quoted = LINK.replace('"', '""')
    (tmp_path / f"run <b>1< {TAG[5:9]}.csv").write_text(f'time_s,ref {TAG},"{quoted} [<b>V</b>]"\n{rows}')
    page = visit()
    upload(page, *tmp_path.glob("*.csv"))
    page.locator("#columns .js-plotly-plot .legend").wait_for(timeout=WAIT_MS)
    legend = page.locator("#columns .legend").text_content()
    assert LINK[-8:] in legend or "…" in legend
    assert "<" in legend
    page.get_by_label("Reference: column", exact=True).locator("visible=true").click()
    page.get_by_role("option").locator("visible=true").first.wait_for()
    picture(page, "hostile-columns")
    page.keyboard.press("Escape")
    page.get_by_label("Serial number", exact=True).fill(f'</script>{TAG}```*\\"')
    page.locator("#confirm").click()
    page.locator("#start").wait_for()
    page.get_by_text("The calibration file: as confirmed above").click()
    page.locator("#calibration-text .plain").wait_for()
    assert TAG in page.locator("#calibration-text .plain").inner_text()
    stays_text(page)

    (tmp_path / "calibration.toml").write_text(f'# ```\n# {TAG} {LINK}\n[reference]\ncolumn = 2\nscale = "{TAG}"\n')
    upload(page, tmp_path / "calibration.toml")
    page.get_by_role("alert").first.wait_for(timeout=WAIT_MS)
    stays_text(page)


def test_a_result_of_unknown_origin_stays_text(visit, picture, tmp_path):
    document = table2().to_dict()
    document["warnings"] = [{"code": "lack_of_fit", "message": f"{TAG} {LINK}"}, {"code": "drift", "message": TAG}]
    document["sensor"] = {"serial_number": f"{TAG}*\\", "type": LINK}
    for signal in document["signals"]:
        signal["record"], signal["unit"] = f"{TAG}{LINK}", f"{LINK}V"
    for parameter in document["parameters"].values():
        parameter["unit"] = f"{LINK}{parameter['unit']}"
    (tmp_path / f"{TAG[:4]}a.json").write_text(json.dumps(document))
    (tmp_path / "b.json").write_text(json.dumps(document))
    page = visit()
    upload(page, *tmp_path.glob("*.json"))
    page.locator("#result .js-plotly-plot").first.wait_for(timeout=WAIT_MS)
    page.locator("#compare .js-plotly-plot").first.wait_for(timeout=WAIT_MS)
    picture(page, "hostile-result")
    stays_text(page)


def stays_text(page) -> None:
    assert page.evaluate("window.pwned") is None
    assert page.locator("a[href*='evil'], a[*|href*='evil'], #main b:text-is('V'), #main img").count() == 0


def test_the_page_talks_to_nobody_else(visit):
    """Even code that got into the page could not send the data elsewhere; another port of this machine is elsewhere."""
    page = visit(may_complain=True)
    with socket.create_server(("127.0.0.1", 0)) as other:
        other.settimeout(0.5)
        port = other.getsockname()[1]
        outcome = page.evaluate(
            f"""async () => {{
              const said = [];
              await fetch('http://127.0.0.1:{port}/', {{mode: 'no-cors'}}).catch(() => said.push('fetch'));
              await new Promise(done => {{
                try {{
                  const ws = new WebSocket('ws://127.0.0.1:{port}/');
                  ws.onerror = () => {{ said.push('ws'); done(); }};
                }} catch {{ said.push('ws'); done(); }}
              }});
              said.push(navigator.sendBeacon('http://127.0.0.1:{port}/', 'x') ? 'sent' : 'beacon');
              const frame = document.createElement('iframe');
              frame.src = 'http://127.0.0.1:{port}/'; document.body.append(frame);
              return said;
            }}"""
        )
        assert outcome[:2] == ["fetch", "ws"]
        assert heard(other) == b""


def heard(other: socket.socket) -> bytes:
    """What is said to it; that a browser opens a connection ahead says nothing."""
    said = b""
    with contextlib.suppress(TimeoutError):
        while True:
            connection, _ = other.accept()
            with connection, contextlib.suppress(TimeoutError):
                connection.settimeout(0.5)
                said += connection.recv(1000)
    return said


def asked(address: str, method: str, path: str, **headers: str) -> int:
    parts = urlsplit(address)
    connection = http.client.HTTPConnection(parts.hostname or "", parts.port, timeout=ANSWER_S)
    try:
        connection.request(method, path, headers={key.replace("_", "-"): value for key, value in headers.items()})
        return connection.getresponse().status
    finally:
        connection.close()


def handshake(address: str, **headers: str) -> int:
    more = {"Upgrade": "websocket", "Connection": "Upgrade", "Sec_WebSocket_Version": "13"}
    key = {"Sec_WebSocket_Key": "dGhlIHNhbXBsZSBub25jZQ=="}
    return asked(address, "GET", "/_nicegui_ws/socket.io/?EIO=4&transport=websocket", **more, **key, **headers)


def test_no_other_name_and_no_other_site_gets_in(server, tmp_path):
    here = urlsplit(server.address).netloc
    assert asked(server.address, "GET", "/", Host=here) == 200
    assert asked(server.address, "GET", "/", Host="evil.example") == 403
    assert handshake(server.address, Host=here, Origin=f"http://{here}") == 101
    assert handshake(server.address, Host=here, Origin="http://evil.example") == 403
    assert handshake(server.address, Host="evil.example", Origin="http://evil.example") == 403


def test_served_to_all_the_address_opens_and_rebinding_is_refused(tmp_path):
    pytest.importorskip("argon2")
    add_account(tmp_path / "accounts", "ina", "identify", "correct horse")
    options = ("--host", "0.0.0.0", "--name", "lab.example", "--auth", str(tmp_path / "accounts"))
    with serving(tmp_path, *VIBRIDENT, "serve", *options) as everywhere:
        assert "0.0.0.0" not in everywhere.address
        here = urlsplit(everywhere.address).netloc
        assert asked(everywhere.address, "GET", "/", Host="lab.example") == 303
        for name in ("evil.example", "192.0.2.1"):
            assert asked(everywhere.address, "GET", "/", Host=name) == 403
            assert handshake(everywhere.address, Host=name, Origin=f"http://{name}") == 403
        assert handshake(everywhere.address, Host=here, Origin=f"http://{here}") == 403  # nobody signed in


def test_requests_cost_no_folder(server):
    def folders() -> int:
        (home,) = (server.folder / "data" / "vibrident" / "page").iterdir()
        return len(list(home.iterdir()))

    before = folders()
    for _ in range(20):
        assert asked(server.address, "GET", "/", Host=urlsplit(server.address).netloc) == 200
    assert folders() == before


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux limits the memory of a process")
@pytest.mark.parametrize(
    "names",
    [("bomb.h5", "calibration.toml"), pytest.param(("declared.h5", "deep.json"), marks=pytest.mark.slow)],
    ids=" ".join,
)
def test_a_bomb_goes_off_elsewhere(visit, server, tmp_path, names):
    """A few kilobytes that unpack to gigabytes; MATLAB and TOML nested without end."""
    with h5py.File(tmp_path / "bomb.h5", "w") as file:
        for name in ("reference", "response"):
            file.create_dataset(name, shape=(10**10,), chunks=(10**6,), compression="gzip", fillvalue=1.0, dtype="f8")
    with h5py.File(tmp_path / "declared.h5", "w") as file:  # 24 GB that were never written
        for name in ("reference", "response"):
            file.create_dataset(name, shape=(3 * 10**9,), dtype="f8")
    (tmp_path / "deep.json").write_text("[" * 200_000)
    (tmp_path / "calibration.toml").write_text("a = " + "[" * 50_000)
    assert (tmp_path / "bomb.h5").stat().st_size < 10_000
    page = visit()
    (tmp_path / "data.csv").write_text("t,a,v\n" + "".join(f"{i / 100},{i % 7},{i % 5}\n" for i in range(50)))
    for name in names:
        upload(page, tmp_path / name, *([tmp_path / "data.csv"] if name == "calibration.toml" else []))
        page.get_by_role("alert").first.wait_for(timeout=WAIT_MS)
        assert "Traceback" not in page.content()
        print(f"{name}: {page.get_by_role('alert').first.inner_text().splitlines()[0]}")
        start_anew(page)
        page.get_by_text("No data yet.").wait_for()
        page.get_by_role("alert").first.wait_for(state="detached")
    assert server.process.poll() is None
    print(f"most memory that the server ever had: {peak_memory(server.process.pid) / 1e6:.0f} MB")
    assert peak_memory(server.process.pid) < MOST_MEMORY


def test_twenty_uploads_at_once_starve_nobody(server, tmp_path):
    """Each announces all that a user may send and trickles; others are answered meanwhile, and no such upload stays."""
    here = urlsplit(server.address)
    head = f"POST /_nicegui/client/x/upload/1 HTTP/1.1\r\nHost: {here.netloc}\r\nContent-Length: 100000000\r\n\r\n"
    with contextlib.ExitStack() as stack:
        connect = partial(socket.create_connection, (here.hostname, here.port), ANSWER_S)
        sockets = [stack.enter_context(connect()) for _ in range(20)]
        for one in sockets:
            one.sendall(head.encode() + b"x" * 100_000)
        taken = []
        for _ in range(20):
            begin = time.monotonic()
            assert asked(server.address, "GET", "/", Host=here.netloc) == 200
            taken.append(time.monotonic() - begin)
        print(
            f"twenty uploads at once; the page meanwhile: median {statistics.median(taken):.3f} s, {max(taken):.3f} s"
        )
    assert asked(server.address, "GET", "/", Host=here.netloc) == 200
    assert peak_memory(server.process.pid) < MOST_MEMORY
