// The pages work without it; it adds what HTML cannot: copying, and files that are dropped onto a form.
for (const pre of document.querySelectorAll("pre")) {
  const button = Object.assign(document.createElement("button"), { type: "button", className: "copy" });
  button.textContent = "Copy";
  button.setAttribute("aria-label", `Copy: ${pre.getAttribute("aria-label")}`);
  button.addEventListener("click", async () => {
    await navigator.clipboard.writeText(pre.textContent);
    button.textContent = "Copied";
  });
  pre.after(button);
}

for (const live of document.querySelectorAll("[data-state]")) {
  const bar = live.querySelector("progress");
  const told = live.querySelector("output");
  let news;
  const look = async () => {
    const found = await (await fetch(live.dataset.state)).json();
    if (found.over || found.news > (news ?? found.news)) return location.reload();
    news = found.news;
    // Above some thousands of images their number is not known before they are read.
    if (found.total) Object.assign(bar, { max: found.total, value: found.done });
    else bar.removeAttribute("value");
    told.textContent = `${found.done || ""}${found.total ? ` of ${found.total}` : ""} ${found.what}`;
    setTimeout(look, document.hidden ? 5000 : 500);
  };
  look();
}

const FIRST = 64 * 1024; // bytes of each file that are sent unasked
const BATCH = 4 * 1024 * 1024;

// Names of a folder come a hundred at a time.
const walked = async (entry, above, files) => {
  if (entry.isFile) {
    files.push([await new Promise((done, failed) => entry.file(done, failed)), above + entry.name]);
    return;
  }
  const reader = entry.createReader();
  for (;;) {
    const some = await new Promise((done, failed) => reader.readEntries(done, failed));
    if (!some.length) return;
    for (const one of some) await walked(one, `${above}${entry.name}/`, files);
  }
};

const sent = async (form, files) => {
  const told = form.querySelector("output");
  const stop = new AbortController();
  const button = Object.assign(document.createElement("button"), { type: "button", textContent: "Stop" });
  button.addEventListener("click", () => stop.abort(new Error("stopped; nothing was kept")));
  told.after(button);
  const post = async (address, body, signal = stop.signal) => {
    const headers = { "X-Desk-Token": form.elements.token.value, "Content-Type": "application/octet-stream" };
    const answer = await fetch(address, { method: "POST", body, headers, signal });
    if (!answer.ok) throw new Error(await answer.text());
    return answer.json();
  };
  const given = new FormData(form);
  for (const name of ["token", "files"]) given.delete(name);
  let address;
  try {
    const many = `${files.length} ${given.has("whole") || given.has("verify")}`; // pixels need all of a file
    address = `${form.dataset.drops}/${(await post(form.dataset.drops, many)).id}`;
    let left = files.map(([file], number) => [number, [0, Math.min(FIRST, file.size)]]);
    while (left.length) {
      const more = [];
      for (let at = 0; at < left.length; ) {
        const heads = [];
        const parts = [];
        for (let size = 0; at < left.length && size < BATCH; at++) {
          const [number, [start, end]] = left[at];
          const [file, name] = files[number];
          heads.push([number, name, file.size, [[start, end]]]);
          parts.push(file.slice(start, end));
          size += end - start;
        }
        const head = new TextEncoder().encode(JSON.stringify(heads));
        const length = new DataView(new ArrayBuffer(4));
        length.setUint32(0, head.length);
        const answer = await post(address, new Blob([length, head, ...parts]));
        more.push(...answer.more);
        told.textContent = `${answer.done} of ${files.length} files read`;
      }
      left = more;
    }
    location = (await post(`${address}/end`, new URLSearchParams(given).toString())).page;
  } catch (error) {
    told.textContent = `Not done: ${error.message}`;
    button.remove();
    if (address) await post(`${address}/stop`, "", null);
  }
};

for (const input of document.querySelectorAll("form input[type=file]")) {
  const form = input.form;
  const marked = (event) => {
    event.preventDefault();
    place.classList.toggle("over", event.type === "dragover");
  };
  // Of several, each takes what is dropped onto itself, as browsers do.
  const place = form.querySelectorAll("input[type=file]").length > 1 ? input.parentElement : form;
  place.addEventListener("dragover", marked);
  place.addEventListener("dragleave", marked);
  place.addEventListener("drop", (event) => {
    marked(event);
    if (form.dataset.drops) {
      // The entries are there only during the event.
      const entries = [...event.dataTransfer.items].map((item) => item.webkitGetAsEntry()).filter(Boolean);
      const files = [];
      Promise.all(entries.map((entry) => walked(entry, "", files))).then(() => sent(form, files));
      return;
    }
    if (!event.dataTransfer.files.length) return;
    const one = new DataTransfer();
    one.items.add(event.dataTransfer.files[0]);
    input.files = one.files;
    if (place === form) form.requestSubmit();
  });
  if (form.dataset.drops) {
    form.addEventListener("submit", (event) => {
      if (!input.files.length) return;
      event.preventDefault();
      sent(form, [...input.files].map((file) => [file, file.webkitRelativePath || file.name]));
    });
  }
}
