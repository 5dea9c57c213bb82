#pragma once

#include <fcntl.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <stdexcept>
#include <string>
#include <vector>

namespace orbid::tests {

/// The program as a process of its own, its standard error read line by line: signals can be sent between lines.
class Process {
public:
    explicit Process(const std::vector<std::string>& arguments) {
        int ends[2];
        if (::pipe2(ends, O_CLOEXEC) != 0) throw std::runtime_error("no pipe");
        process_ = ::fork();
        if (process_ < 0) throw std::runtime_error("no process");
        if (process_ == 0) {
            ::dup2(ends[1], STDERR_FILENO);
            const int nothing = ::open("/dev/null", O_WRONLY);
            ::dup2(nothing, STDOUT_FILENO);
            std::vector<char*> words;
            std::string program = ORBID_PROGRAM;
            words.push_back(program.data());
            std::vector<std::string> copies = arguments;
            for (std::string& argument : copies)
                words.push_back(argument.data());
            words.push_back(nullptr);
            ::execv(program.c_str(), words.data());
            ::_exit(127);
        }
        ::close(ends[1]);
        error_ = ends[0];
    }
    ~Process() {
        if (process_ > 0) {
            ::kill(process_, SIGKILL);
            end();
        }
        ::close(error_);
    }
    Process(const Process&) = delete;
    Process& operator=(const Process&) = delete;

    /// Reads up to the line that begins so. @return false when the output ends before.
    bool reads(const std::string& beginning) {
        while (true) {
            const auto end = left_.find('\n');
            if (end != std::string::npos) {
                const std::string line = left_.substr(0, end);
                left_.erase(0, end + 1);
                text_ += line + '\n';
                if (line.starts_with(beginning)) return true;
                continue;
            }
            char buffer[4096];
            const ssize_t count = ::read(error_, buffer, sizeof(buffer));
            if (count <= 0) return false;
            left_.append(buffer, static_cast<std::size_t>(count));
        }
    }

    void send(int signal) const { ::kill(process_, signal); }

    /// Waits for the end. @return the exit code, or minus the signal that ended it.
    int end() {
        reads("\n");  // no line begins so: up to the end
        int status = 0;
        ::waitpid(process_, &status, 0);
        process_ = -1;
        return WIFSIGNALED(status) ? -WTERMSIG(status) : WEXITSTATUS(status);
    }

    /// What has been read of standard error.
    [[nodiscard]] const std::string& text() const { return text_; }

private:
    pid_t process_ = -1;
    int error_ = -1;
    std::string left_;
    std::string text_;
};

}  // namespace orbid::tests
