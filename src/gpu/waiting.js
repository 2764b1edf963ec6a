// Suspends the WebAssembly that calls `rest` until somebody calls `wake` (JavaScript Promise Integration).

let goOn, woken;
const renew = () => { woken = new Promise((resolve) => { goOn = resolve; }); };
renew();

// A browser without it loads the program all the same, and runs it on the CPU.
export const rest = "Suspending" in WebAssembly ? new WebAssembly.Suspending(() => woken.then(renew)) : () => {
  throw new Error("this browser cannot suspend WebAssembly");
};

export function wake() {
  goOn();
}
