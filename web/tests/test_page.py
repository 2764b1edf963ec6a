"""The page, used as somebody would: by clicks, by files, on a phone."""

import base64
import json
import math
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest
from conftest import GPU

# The filter draws the same random numbers in the browser, but sines, logarithms and sums are rounded otherwise: over a minute, with few
# maps, poses differ by this much at most [m, rad]. Later one resampling comes out otherwise, and from there it is another run.
TOLERANCE = 0.001
# CPU and WebGPU take the same polynomials: what tests/gpu allows after a climb [m, rad].
REFINED = 5e-5
# A machine may be busy [ms].
WAIT = 300_000


def trajectory(path):
    """Rows of t, x, y, heading."""
    rows = [list(map(float, line.split())) for line in Path(path).read_text().splitlines() if not line.startswith("#")]
    return [(t, x, y, 2 * math.atan2(qz, qw)) for t, x, y, _, _, _, qz, qw in rows]


def difference(one, other):
    """The largest difference of two trajectories of the same readings, in metres and radians."""
    assert [row[0] for row in one] == [row[0] for row in other], "other readings"
    metres = max(math.dist(a[1:3], b[1:3]) for a, b in zip(one, other))
    radians = max(abs(math.remainder(a[3] - b[3], math.tau)) for a, b in zip(one, other))
    return max(metres, radians)


def numbers(page):
    """What the page counts."""
    names, values = page.locator("#numbers dt").all_inner_texts(), page.locator("#numbers dd").all_inner_texts()
    return dict(zip(names, values, strict=True))


def count(text):
    return int(text.replace(",", ""))


def wait_for_share(page, share):
    """Until more than this is done. What Playwright waits by itself for is code in a text, which the page forbids."""
    for _ in range(WAIT // 20):
        if page.evaluate("document.getElementById('bar').value") > share:
            return
        page.wait_for_timeout(20)
    pytest.fail(f"{page.inner_text('#status')!r} after {WAIT / 1000} s")


def wait_for_result(page):
    page.wait_for_selector("#result:visible, #error:visible", timeout=WAIT)
    assert page.inner_text("#error") == "" or not page.is_visible("#error"), page.inner_text("#error")


def save(page, name, folder):
    with page.expect_download() as download:
        page.click(f"text={name}")
    path = folder / name
    download.value.save_as(path)
    return path


def drawn(page):
    """Share of the pixels of the canvas that are not its ground."""
    return page.evaluate("""() => {
        const canvas = document.getElementById("canvas");
        const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
        const pixels = new Uint32Array(data.buffer);
        return pixels.filter((pixel) => pixel !== pixels[0]).length / pixels.length;
    }""")


def colours(page):
    """How many of the map's colours the canvas shows."""
    return page.evaluate("""() => {
        const canvas = document.getElementById("canvas"), style = getComputedStyle(canvas);
        const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
        const seen = new Set();
        for (let i = 0; i < data.length; i += 4) seen.add((data[i] << 16) | (data[i + 1] << 8) | data[i + 2]);
        const of = (name) => parseInt(style.getPropertyValue(name).trim().slice(1), 16);
        return Object.fromEntries(["--paper", "--free", "--wall", "--path"].map((name) => [name, seen.has(of(name))]));
    }""")


def assert_same(ours, theirs, tolerance=TOLERANCE):
    assert difference(ours, theirs) < tolerance
    # The comparison sees what is a little off.
    moved = [*ours[:-1], (ours[-1][0], ours[-1][1] + 2 * tolerance, *ours[-1][2:])]
    turned = [*ours[:-1], (*ours[-1][:3], ours[-1][3] + 2 * tolerance)]
    assert difference(moved, theirs) > tolerance and difference(turned, theirs) > tolerance


def test_the_demo_is_mapped(open_page, tmp_path):
    page = open_page()
    assert drawn(page) == 0
    page.click("#demo")
    # The page lives while its worker maps: the bar goes on and the map grows.
    wait_for_share(page, 0.1)
    live = numbers(page)
    assert count(live["Particles"]) == 32 and 1 <= float(live["Effective sample size"]) <= 32
    wait_for_share(page, 0.3)
    assert count(numbers(page)["Scans"]) > count(live["Scans"]) and drawn(page) > 0.005
    wait_for_result(page)
    assert page.inner_text("#verdict") == "Consistent"
    # The map comes to its place softly.
    page.wait_for_timeout(1000)
    assert drawn(page) > 0.05 and all(colours(page).values()), colours(page)

    found = numbers(page)
    assert count(found["Scans"]) == 1532 and 170 <= count(found["Walls"]) <= 240
    path = [float(number) for number in found["Path"].split()[:1]][0]
    assert 270 < path < 285
    save(page, "trajectory.tum", tmp_path)
    walls = json.loads(save(page, "map.json", tmp_path).read_text())
    assert len(walls["clusters"]) == count(found["Walls"]) and walls["free"]
    svg = ElementTree.parse(save(page, "map.svg", tmp_path)).getroot()
    assert svg.tag == "{http://www.w3.org/2000/svg}svg"


@pytest.mark.parametrize("way", ["chosen", "dropped"])
def test_a_log_is_mapped_as_the_program_maps_it(way, open_page, drive, tmp_path):
    log, by_program = drive
    page = open_page()
    page.fill("#maps", "4")
    page.fill("#seed", "7")
    if way == "chosen":
        with page.expect_file_chooser() as chooser:
            page.click("#choose")
        chooser.value.set_files(log)
    else:
        data = page.evaluate_handle("""([name, text]) => {
            const data = new DataTransfer();
            data.items.add(new File([Uint8Array.from(atob(text), (c) => c.charCodeAt())], name));
            return data;
        }""", [log.name, base64.b64encode(log.read_bytes()).decode()])
        page.dispatch_event("body", "dragover", {"dataTransfer": data})
        assert page.is_visible("#drop")
        page.dispatch_event("body", "drop", {"dataTransfer": data})
        assert not page.is_visible("#drop")
    wait_for_result(page)
    assert page.inner_text("#name") == log.name
    assert_same(trajectory(save(page, "trajectory.tum", tmp_path)), trajectory(by_program / "trajectory.tum"))


def map_with(page, log, backend):
    """The log with 4 maps and seed 7."""
    page.fill("#maps", "4")
    page.fill("#seed", "7")
    page.select_option("#backend", backend)
    page.set_input_files("#file", log)
    wait_for_result(page)


def test_webgpu_maps_as_the_cpu_does(open_page, stretch, tmp_path):
    page = open_page(GPU)
    paths = {}
    for backend, said in [("gpu", "WebGPU"), ("cpu", "CPU"), ("auto", "CPU (the browser has no GPU)")]:
        map_with(page, stretch, backend)
        assert numbers(page)["Evaluated on"].startswith(said) and not page.is_visible("#warnings-box")
        paths[backend] = trajectory(save(page, "trajectory.tum", tmp_path))
    assert_same(paths["gpu"], paths["cpu"], REFINED)
    # Another device it was: the last bits are others.
    assert paths["gpu"] != paths["cpu"] and paths["auto"] == paths["cpu"]


# Ends the device at the 50th submission, as a driver may.
LOSE = """
    const open = GPUAdapter.prototype.requestDevice, submit = GPUQueue.prototype.submit;
    let device, left = 50;
    GPUAdapter.prototype.requestDevice = async function (...how) { return (device = await open.apply(this, how)); };
    GPUQueue.prototype.submit = function (...work) { if (--left === 0) device.destroy(); return submit.apply(this, work); };
"""


def test_where_the_gpu_is_lost_the_cpu_goes_on(open_page, stretch, tmp_path):
    page = open_page(GPU)

    def lose(route):
        response = route.fetch()
        route.fulfill(response=response, body=LOSE + response.text())

    page.route("**/worker.js", lose)
    map_with(page, stretch, "gpu")
    assert page.is_visible("#warnings-box") and "WebGPU" in page.text_content("#warnings")
    with_loss = trajectory(save(page, "trajectory.tum", tmp_path))
    map_with(page, stretch, "cpu")
    assert_same(with_loss, trajectory(save(page, "trajectory.tum", tmp_path)), REFINED)


def test_without_webgpu_the_cpu_does_all(open_page):
    page = open_page()
    page.select_option("#backend", "gpu")
    page.click("#demo")
    page.wait_for_selector("#error:has-text('no device')", timeout=WAIT)


def test_what_cannot_be_mapped_says_why(open_page):
    page = open_page()
    for name, content, said in [
        ("broken.clf", b"this is no log\n", "no CARMEN message"),
        ("empty.log", b"", "the file is empty"),
        ("cut.mcap", b"\x89MCAP0\r\n\x01\xff", "cut off"),
        ("bag.db3", b"SQLite format 3\0", "from a file only"),
        ("odometry.log", b"ODOM 0 0 0 0 0 0 1 host 0\n", "no laser reading"),
    ]:
        page.set_input_files("#file", files=[{"name": name, "mimeType": "text/plain", "buffer": content}])
        page.wait_for_selector(f"#error:has-text('{said}')", timeout=WAIT)
        assert name.split(".")[0] in page.inner_text("#error") and not page.is_visible("#result")
        assert page.is_visible("#empty") and not page.is_visible("#stop")
    page.fill("#maps", "0")
    page.click("#demo")
    page.wait_for_selector("#error:has-text('maps: a whole number from 1')")


def test_it_stops_and_starts_again(open_page):
    page = open_page()
    page.click("#demo")
    wait_for_share(page, 0)
    page.click("#stop")
    assert page.inner_text("#status") == "Stopped." and not page.is_visible("#bar")
    page.click("#demo")
    wait_for_share(page, 0)


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_it_fits_a_phone(scheme, open_page):
    page = open_page(viewport={"width": 390, "height": 844}, has_touch=True, color_scheme=scheme)
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    for button in ["#demo", "#choose"]:
        box = page.locator(button).bounding_box()
        assert box["height"] >= 40 and 0 <= box["x"] and box["x"] + box["width"] <= 390
    ground = page.evaluate("getComputedStyle(document.body).backgroundColor")
    brightness = sum(map(int, ground[4:-1].split(",")))
    assert (brightness > 3 * 200) == (scheme == "light")
