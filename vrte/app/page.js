// What the page does in the browser, without asking the server.
window.vrte = {
  // the dialog that chooses a file
  pick(upload) {
    getElement(upload).$refs.qRef.pickFiles();
  },
  // a file dropped anywhere on the page goes where a chosen one goes
  take_drops(upload) {
    const over = (event) => [...(event.dataTransfer?.types ?? [])].includes("Files");
    const lit = (on) => document.body.classList.toggle("vrte-dropping", on);
    document.addEventListener("dragover", (event) => {
      if (over(event)) event.preventDefault(), lit(true);
    });
    document.addEventListener("dragleave", (event) => event.relatedTarget ?? lit(false));
    document.addEventListener("drop", (event) => {
      if (!over(event)) return;
      event.preventDefault();
      lit(false);
      getElement(upload)?.$refs.qRef.addFiles(event.dataTransfer.files);
    });
  },
};
