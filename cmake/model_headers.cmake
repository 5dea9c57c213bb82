# Writes the names of the headers that a compiled model includes, and the SHA-256 over them as apps/job/model_plugin.cpp computes
# it, into a source file.
#   cmake -DSOURCE=... -DFILES="a.hpp|b.hpp" -DOUTPUT=... -P model_headers.cmake
string(REPLACE "|" ";" files "${FILES}")
list(SORT files COMPARE STRING)
set(text "")
set(names "")
foreach(file IN LISTS files)
  file(SHA256 ${SOURCE}/${file} digest)
  string(APPEND text "${file} ${digest}\n")
  string(APPEND names "    \"${file}\",\n")
endforeach()
string(SHA256 digest "${text}")
file(CONFIGURE OUTPUT ${OUTPUT} CONTENT [[
// Written by the build: cmake/model_headers.cmake.
namespace orbid::apps {
extern const char* const model_headers_sha256;
extern const char* const model_headers[];
const char* const model_headers_sha256 = "@digest@";
const char* const model_headers[] = {
@names@    nullptr};
}  // namespace orbid::apps
]] @ONLY)
