#include "apps/job/input_checksums.hpp"

#include <filesystem>
#include <string>

#include <fmt/format.h>

#include "apps/documents/fingerprint.hpp"
#include "apps/job/data_job.hpp"
#include "apps/job/orbits_job.hpp"
#include "orbits/records/data_error.hpp"

namespace orbid::apps {

namespace {

void sign(const std::filesystem::path& path, std::string& expected) {
    if (!std::filesystem::exists(path)) throw orbits::DataError(fmt::format("{}: no such file", path.string()));
    const std::string found = sha256_of_file(path);
    if (!expected.empty() && expected != found)
        throw orbits::DataError(
            fmt::format("{}: is not the file the job was made for: its SHA-256 is {}, the job says {}", path.string(),
                        found, expected));
    expected = found;
}

}  // namespace

void sign_files(Job& job) {
    for (DataJob& data : job.data) {
        if (data.file) sign(data.file->path, data.file->sha256);
        if (data.inputs && data.inputs->file) sign(*data.inputs->file, data.inputs->sha256);
    }
    if (job.orbits && job.orbits->file) sign(*job.orbits->file, job.orbits->sha256);
}

}  // namespace orbid::apps
