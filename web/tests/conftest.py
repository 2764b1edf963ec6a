"""The page as a browser gets it from a server, and what the program itself makes of the same drive."""

import functools
import http.server
import os
import shutil
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from playwright.sync_api import sync_playwright

PAGE = Path(os.environ.get("IPSLAM_PAGE", Path(__file__).parents[2] / "target/page"))
BROWSER = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
PROGRAM = os.environ.get("IPSLAM_PROGRAM", Path(sys.executable).parent / "ipslam")
# A browser that asks nothing of the world outside.
FLAGS = [
    "--no-sandbox",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]
NO_GPU = ["--disable-gpu"]
# WebGPU in software, which every machine has.
GPU = ["--enable-unsafe-webgpu", "--use-webgpu-adapter=swiftshader"]


class Quiet(http.server.SimpleHTTPRequestHandler):
    def log_message(self, *_):
        pass


@pytest.fixture(scope="session")
def address():
    assert (PAGE / "ipslam_web_bg.wasm").is_file(), f"{PAGE}: build the page first: cargo run -p ipslam-web-build"
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Quiet, directory=PAGE))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_port}/"
    server.shutdown()


@pytest.fixture(scope="session")
def launch():
    """Starts a browser with more flags, once."""
    browsers = {}
    with sync_playwright() as playwright:

        def launch(flags):
            key = tuple(flags)
            if key not in browsers:
                browsers[key] = playwright.chromium.launch(executable_path=BROWSER, args=FLAGS + flags)
            return browsers[key]

        yield launch
        for browser in browsers.values():
            browser.close()


@pytest.fixture
def open_page(launch, address):
    """Opens the page; at the end nothing may have failed, and nothing been asked of anybody else."""
    contexts, troubles = [], []

    def open_page(flags=NO_GPU, **options):
        context = launch(flags).new_context(**options)
        contexts.append(context)
        context.on("weberror", lambda error: troubles.append(str(error.error)))
        context.on("console", lambda message: message.type == "error" and troubles.append(message.text))
        context.on("request", lambda request: request.url.startswith((address, "blob:", "data:")) or troubles.append(request.url))
        page = context.new_page()
        page.goto(address)
        return page

    yield open_page
    for context in contexts:
        context.close()
    assert troubles == []


@pytest.fixture(scope="session")
def stretch(tmp_path_factory):
    """The log of a drive of 15 seconds: WebGPU in software takes its time."""
    folder = tmp_path_factory.mktemp("stretch")
    subprocess.run([PROGRAM, "simulate", "--out", folder, "--duration", "15"], check=True, capture_output=True)
    return folder / "building-seed1.log"


@pytest.fixture(scope="session")
def drive(tmp_path_factory):
    """The log of a minute's drive through the building, and what the program makes of it with 4 maps and seed 7."""
    folder = tmp_path_factory.mktemp("drive")
    subprocess.run([PROGRAM, "simulate", "--out", folder, "--duration", "60"], check=True, capture_output=True)
    log = folder / "building-seed1.log"
    out = folder / "out"
    subprocess.run([PROGRAM, "run", log, "--maps", "4", "--seed", "7", "--out", out], check=True, capture_output=True)
    return log, out
