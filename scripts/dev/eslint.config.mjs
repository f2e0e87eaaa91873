// The rules of scripts/dev/lint for the page in web/ and the client of a test.
const globals =
  "Image Option ResizeObserver URL WebSocket addEventListener console createImageBitmap devicePixelRatio document " +
  "fetch getComputedStyle location matchMedia navigator performance process requestAnimationFrame sessionStorage " +
  "setInterval setTimeout window";
const rules =
  "eqeqeq no-const-assign no-dupe-args no-dupe-else-if no-dupe-keys no-duplicate-case no-eval " +
  "no-import-assign no-redeclare no-self-assign no-self-compare no-shadow no-undef no-unreachable no-unused-vars " +
  "no-useless-return no-var prefer-const use-isnan valid-typeof";

export default [
  {
    languageOptions: {
      globals: Object.fromEntries(
        globals.split(" ").map((name) => [name, "readonly"]),
      ),
    },
    rules: Object.fromEntries(rules.split(" ").map((name) => [name, "error"])),
  },
];
