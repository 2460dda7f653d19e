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

for (const input of document.querySelectorAll("form input[type=file]")) {
  const form = input.form;
  const marked = (event) => {
    event.preventDefault();
    form.classList.toggle("over", event.type === "dragover");
  };
  form.addEventListener("dragover", marked);
  form.addEventListener("dragleave", marked);
  form.addEventListener("drop", (event) => {
    marked(event);
    if (form.dataset.drops || !event.dataTransfer.files.length) return;
    const one = new DataTransfer();
    one.items.add(event.dataTransfer.files[0]);
    input.files = one.files;
    form.requestSubmit();
  });
}
