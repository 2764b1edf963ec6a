// Maps one log, beside the page, which stays live.

import init, { Settings, give_building, give_log, take } from "./ipslam_web.js";

const viewer = {
  progress: (doing, share) => postMessage({ kind: "progress", doing, share }),
  step: (walls, path, scan, particles, scans, effective) => {
    const shown = { walls, path, scan, particles };
    postMessage({ kind: "step", shown, scans, effective }, [walls, path, scan, particles].map((numbers) => numbers.buffer));
  },
};

onmessage = async ({ data: { file, maps, seed, backend, scanTopic, odometryTopic } }) => {
  try {
    const { work } = await init({ module_or_path: "ipslam_web_bg.wasm" });
    const settings = new Settings(maps, seed, backend, scanTopic, odometryTopic);
    if (file) give_log(file.name, new Uint8Array(await file.arrayBuffer()), settings, viewer);
    else give_building(settings, viewer);
    // What waits for a GPU is suspended.
    await (backend === "cpu" ? work : WebAssembly.promising(work))();
    const mapped = take();
    const summary = JSON.parse(mapped.summary());
    const cells = mapped.cells();
    const none = new Float32Array();
    const shown = { walls: mapped.walls(), path: mapped.path(), scan: none, particles: none, grid: summary.grid, cells };
    const files = { "map.json": mapped.map_json(), "trajectory.tum": mapped.trajectory(), "map.svg": mapped.svg() };
    postMessage({ kind: "finished", shown, summary, files });
  } catch (error) {
    // The library's errors are texts; all else is the browser's.
    const text = typeof error === "string" ? error : `The browser could not go on: ${error}. Is the log too large for its memory?`;
    postMessage({ kind: "error", text });
  }
};
