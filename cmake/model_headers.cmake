# Writes the SHA-256 over the headers that a compiled model includes, as apps/model_plugin.cpp computes it, into a source file.
#   cmake -DSOURCE=... -DOUTPUT=... -P model_headers.cmake
file(GLOB files RELATIVE ${SOURCE} ${SOURCE}/models/*.hpp)
list(APPEND files models/parameter.cpp models/input_evaluation.cpp)
list(SORT files COMPARE STRING)
set(text "")
foreach(file IN LISTS files)
  file(SHA256 ${SOURCE}/${file} digest)
  string(APPEND text "${file} ${digest}\n")
endforeach()
string(SHA256 digest "${text}")
file(CONFIGURE OUTPUT ${OUTPUT} CONTENT [[
// Written by the build: cmake/model_headers.cmake.
namespace orbid::apps {
extern const char* const model_headers_sha256;
const char* const model_headers_sha256 = "@digest@";
}  // namespace orbid::apps
]] @ONLY)
