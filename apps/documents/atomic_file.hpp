#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <stdexcept>
#include <string>
#include <string_view>

namespace orbid::apps {

/// A file cannot be written; what() names path and reason.
class FileNotWritten : public std::runtime_error {
    using std::runtime_error::runtime_error;
};

/// Writes a file whole or not at all: temporary in the same folder, write, fsync, rename, fsync of the folder.
///
/// A reader sees the old file or the new one, never a part, even after a power cut. On failure the temporary is removed
/// and an existing file is unchanged.
/// @throws FileNotWritten
void write_atomically(const std::filesystem::path& path, std::string_view bytes);

/// The same for writers that need a path (HDF5): `writer` creates the file it is given and closes it. The temporary
/// ends in the final file name, so that its extension still gives the format.
///
/// Exceptions of `writer` pass on after the temporary is removed. A DataError of its names the file, not the temporary.
/// @param interrupted  asked while the file goes to the disk: the file is given up if it says so
/// @throws FileNotWritten; models::Stopped.
void write_atomically(const std::filesystem::path& path,
                      const std::function<void(const std::filesystem::path& temporary)>& writer,
                      const std::function<bool()>& interrupted = {});

/// How names of this process's temporaries begin: with its number and a digest of the machine's name, as processes of
/// other machines may share the folder.
[[nodiscard]] std::string temporary_start();

/// Removes temporaries that a killed program left in a folder, and folders of such names: those of ended processes of
/// this machine, and any untouched for more than a day (another process may have that number by then). A folder that
/// cannot be read is ignored.
/// @param file  only those of this file, by its name; empty: of all
void remove_leftover_temporaries(const std::filesystem::path& folder, std::string_view file = {});

/// A file cannot be read; what() names path and reason.
class FileUnreadable : public std::runtime_error {
    using std::runtime_error::runtime_error;
};

/// Largest file that is read as a document: of jobs and campaigns, and of anything else.
inline constexpr std::uintmax_t largest_job_file = std::uintmax_t{64} << 20;
inline constexpr std::uintmax_t largest_document = std::uintmax_t{1} << 30;

/// The whole file as bytes.
/// @param pipes  whether it may be a pipe, which is read to its end: /dev/stdin. Else a pipe, on which a program may
///               wait for ever, is refused. Devices always are.
/// @throws FileUnreadable naming path and reason, also for more than `most` bytes.
[[nodiscard]] std::string read_whole_file(const std::filesystem::path& path, std::uintmax_t most = largest_document,
                                          bool pipes = false);

}  // namespace orbid::apps
