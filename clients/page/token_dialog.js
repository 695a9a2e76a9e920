// SPDX-License-Identifier: Apache-2.0
// Asks for the token that a server with --token-file wants.

/** Resolves with the typed token. Nothing works without one, so the dialog stays until then. */
export function askForToken(dialog, field) {
  field.value = '';
  dialog.showModal();
  return new Promise((resolve) => {
    const closed = () => {
      if (!field.value) {
        dialog.showModal(); // Escape
        return;
      }
      dialog.removeEventListener('close', closed);
      resolve(field.value);
    };
    dialog.addEventListener('close', closed);
  });
}
