# Clocks without a call. Data behind it: time, limit, cost, looks, looks left; ns.
        .text
        .set    DATA, start + 1024
start:
clock_gettime:                  # edi: clock, rsi: timespec
        movabs  $1767225600000000000, %rcx
        test    %edi, %edi
        je      1f
        movabs  $1000000000000, %rcx
        cmp     $1, %edi
        je      1f
        cmp     $4, %edi
        je      1f
        cmp     $6, %edi
        je      1f
        cmp     $7, %edi
        je      1f
        jmp     2f
1:      call    look
        jc      2f
        mov     %rax, (%rsi)
        mov     %rdx, 8(%rsi)
        xor     %eax, %eax
        ret
2:      mov     $228, %eax
        syscall
        ret
gettimeofday:                   # rdi: timeval, rsi: zone
        test    %rsi, %rsi
        jne     3f
        test    %rdi, %rdi
        je      3f
        movabs  $1767225600000000000, %rcx
        call    look
        jc      3f
        mov     %rax, (%rdi)
        mov     %rdx, %rax
        xor     %edx, %edx
        mov     $1000, %r9d
        div     %r9
        mov     %rax, 8(%rdi)
        xor     %eax, %eax
        ret
3:      mov     $96, %eax
        syscall
        ret
time:                           # rdi: time_t or nothing
        movabs  $1767225600000000000, %rcx
        call    look
        jc      5f
        test    %rdi, %rdi
        je      4f
        mov     %rax, (%rdi)
4:      ret
5:      mov     $201, %eax
        syscall
        ret
clock_getres:
        mov     $229, %eax
        syscall
        ret
getcpu:
        mov     $309, %eax
        syscall
        ret
getrandom:                      # ENOSYS: the caller makes the call
        mov     $-38, %rax
        ret
look:                           # rcx: what the clock showed at 0; rax, rdx: s, ns; or carry
        lea     DATA(%rip), %r8
        mov     (%r8), %rax
        add     16(%r8), %rax
        cmp     8(%r8), %rax
        ja      6f
        decq    32(%r8)
        js      6f
        mov     %rax, (%r8)
        incq    24(%r8)
        add     %rcx, %rax
        xor     %edx, %edx
        mov     $1000000000, %r9d
        div     %r9
        clc
        ret
6:      stc
        ret
