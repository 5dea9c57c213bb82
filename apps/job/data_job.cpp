#include "apps/job/data_job.hpp"

#include <system_error>

namespace orbid::apps {

double FileJob::bytes() const {
    double sum = 0.0;
    for (const auto& path : paths) {
        std::error_code error;
        const auto size = std::filesystem::file_size(path, error);
        if (!error) sum += static_cast<double>(size);
    }
    return sum;
}

std::string FileJob::segment_name(const std::filesystem::path& path, const std::string& label) const {
    if (pattern.empty()) return label;
    const std::size_t folder = pattern.rfind('/', pattern.find_first_of("*?["));
    std::filesystem::path name = folder == std::string::npos ? path.string() : path.string().substr(folder + 1);
    name.replace_extension();
    return table && segment_column.empty() ? name.string() : name.string() + "/" + label;
}

}  // namespace orbid::apps
