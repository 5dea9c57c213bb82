#include "apps/job/input_checksums.hpp"

#include <filesystem>
#include <string>

#include <fmt/format.h>

#include "apps/documents/fingerprint.hpp"
#include "apps/job/data_job.hpp"
#include "apps/job/estimate_job.hpp"
#include "apps/job/orbits_job.hpp"
#include "orbits/records/data_error.hpp"
#include "orbits/records/data_file.hpp"

namespace orbid::apps {

namespace {

std::string checksum(const std::filesystem::path& path) {
    (void)orbits::require_data_file(path);
    return sha256_of_file(path);
}

void sign(const std::string& shown, const std::string& found, std::string& expected) {
    if (!expected.empty() && expected != found)
        throw orbits::DataError(fmt::format(
            "{}: is not the file the job was made for: its SHA-256 is {}, the job says {}", shown, found, expected));
    expected = found;
}

void sign(const std::filesystem::path& path, std::string& expected) {
    sign(path.string(), checksum(path), expected);
}

/// Of several files: of the lines "SHA-256, two blanks, name" that sha256sum prints in their folder.
void sign(FileJob& file) {
    if (file.pattern.empty()) return sign(file.paths.front(), file.sha256);
    std::string list;
    for (const auto& path : file.paths)
        list += fmt::format("{}  {}\n", checksum(path), path.filename().string());
    sign(file.pattern, sha256(list), file.sha256);
}

}  // namespace

void sign_files(Job& job) {
    for (DataJob& data : job.data) {
        if (data.file) sign(*data.file);
        if (data.inputs && data.inputs->file) sign(*data.inputs->file, data.inputs->sha256);
    }
    if (job.orbits && job.orbits->file) sign(*job.orbits->file, job.orbits->sha256);
    if (job.estimate && job.estimate->branch) sign(*job.estimate->branch->file, job.estimate->branch->sha256);
}

}  // namespace orbid::apps
